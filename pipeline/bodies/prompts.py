"""What a user says of the bodies in a clip: points, boxes, how many, and what to ignore."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.errors import ParamsError


@dataclass(frozen=True)
class Mark:
    """A place in a picture: a point or a box.

    Attributes:
        at: (x, y) or (left, top, right, bottom), px of the video's own picture.
        time: s from the beginning of the video; None: where the clip begins.
    """

    at: tuple[float, ...]
    time: float | None = None

    def __str__(self) -> str:
        when = "" if self.time is None else f",{self.time:g}"
        return ",".join(f"{v:g}" for v in self.at) + when


@dataclass(frozen=True)
class Prompts:
    """What a user says of a clip.

    Attributes:
        points: A body is there.
        boxes: A body fills this box.
        ignored: What is there is no body that counts.
        objects: So many bodies are kept, the most likely ones; None: those that are likely.
    """

    points: tuple[Mark, ...] = ()
    boxes: tuple[Mark, ...] = ()
    ignored: tuple[Mark, ...] = ()
    objects: int | None = None

    def __bool__(self) -> bool:
        return bool(self.points or self.boxes or self.ignored or self.objects is not None)

    @staticmethod
    def of(
        points: Sequence[Sequence[float]] = (),
        boxes: Sequence[Sequence[float]] = (),
        ignore: Sequence[Sequence[float]] = (),
        objects: int | None = None,
    ) -> Prompts:
        """Prompts from plain numbers: points and `ignore` (x, y) or (x, y, t), boxes (x0, y0, x1, y1) or with t."""
        if objects is not None and objects < 1:
            raise ParamsError(f"objects: {objects}; valid: 1 or more")
        return Prompts(
            points=tuple(mark(p, 2, "point") for p in points),
            boxes=tuple(mark(b, 4, "box") for b in boxes),
            ignored=tuple(mark(p, 2, "ignore") for p in ignore),
            objects=objects,
        )

    def record(self) -> dict[str, Any]:
        """For result.json: px of the video's own picture, s from its beginning."""
        marks = {"points": self.points, "boxes": self.boxes, "ignored": self.ignored}
        lists = {name: [{"px": list(m.at), "time_s": m.time} for m in some] for name, some in marks.items()}
        return {**lists, "objects": self.objects}

    def check(self, size: tuple[int, int], times: np.ndarray) -> None:
        """Raise ParamsError for a mark that is not in the picture, size (width, height) px, or not in the clip, whose
        frames have these times (T,), s."""
        for name, marks in (("--point", self.points), ("--box", self.boxes), ("--ignore", self.ignored)):
            for each in marks:
                _check(name, each, size, times)


def mark(numbers: Sequence[float], length: int, name: str) -> Mark:
    """Coordinates and perhaps a time. Raises ParamsError where their number or a box's shape is wrong."""
    form = "x,y or x,y,t" if length == 2 else "x0,y0,x1,y1 or x0,y0,x1,y1,t"
    values = tuple(float(v) for v in numbers)
    if len(values) not in (length, length + 1) or not all(map(np.isfinite, values)):
        raise ParamsError(f"{name} {','.join(f'{v:g}' for v in values)}: valid: {form}, finite numbers")
    at, time = values[:length], values[length] if len(values) > length else None
    if length == 4:
        at = (min(at[0], at[2]), min(at[1], at[3]), max(at[0], at[2]), max(at[1], at[3]))
        if at[0] == at[2] or at[1] == at[3]:
            raise ParamsError(f"{name} {','.join(f'{v:g}' for v in values)}: it is empty; valid: two opposite corners")
    return Mark(at, time)


def frame_of(each: Mark, times: np.ndarray) -> int:
    """The frame, of those at these times (T,), that a mark means."""
    return 0 if each.time is None else int(np.abs(times - each.time).argmin())


def _check(name: str, each: Mark, size: tuple[int, int], times: np.ndarray) -> None:
    width, height = size
    xs, ys = each.at[::2], each.at[1::2]
    if len(each.at) == 2 and not (0 <= xs[0] < width and 0 <= ys[0] < height):
        raise ParamsError(
            f"{name} {each}: it is outside of the picture; valid: x from 0 to {width - 1}, y from 0 to {height - 1}, "
            "px of the video's own picture"
        )
    if len(each.at) == 4 and not (xs[1] > 0 and xs[0] < width and ys[1] > 0 and ys[0] < height):
        raise ParamsError(f"{name} {each}: it is outside of the picture; valid: in 0,0,{width},{height}, px")
    slack = float(np.median(np.diff(times)))
    if each.time is not None and not times[0] - slack <= each.time <= times[-1] + slack:
        raise ParamsError(
            f"{name} {each}: {each.time:g} s is outside of the clip; valid: {times[0]:.2f} to {times[-1]:.2f} s from "
            "the beginning of the video"
        )
