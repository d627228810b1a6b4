"""Changes of found bodies by clicks: drop, join, split, add. Masks are (T, H, W) uint8, 0 or the body's number."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from pipeline.errors import ParamsError
from pipeline.vision.recordings.mask_file import renumbered

NEAR_PX = 6  # a click this far beside a body still means it
MOST_STEPS = 20  # that can be undone
Point = tuple[float, float]


@dataclass(frozen=True)
class BodyMasks:
    """Masks and how they came about.

    Attributes:
        masks: (T, H, W) uint8: 0, or 1 to N.
        before: Earlier masks, the latest last.
    """

    masks: np.ndarray
    before: tuple[np.ndarray, ...] = field(default=())

    @property
    def count(self) -> int:
        return int(self.masks.max(initial=0))

    def changed(self, masks: np.ndarray) -> BodyMasks:
        """With other masks, whose numbers are made 1 to N."""
        return BodyMasks(renumbered(masks), (*self.before, self.masks)[-MOST_STEPS:])

    def undone(self) -> BodyMasks:
        """As they were before the last change. Raises ParamsError where there was none."""
        if not self.before:
            raise ParamsError("there is nothing to undo")
        return BodyMasks(self.before[-1], self.before[:-1])


def body_at(masks: np.ndarray, frame: int, point: Point) -> int:
    """The number of the body at a point (x, y), px, of a frame, or nearest within NEAR_PX. Raises ParamsError."""
    shown = masks[frame]
    rows, cols = np.nonzero(shown)
    if len(rows):
        apart = np.hypot(cols + 0.5 - point[0], rows + 0.5 - point[1])
        nearest = int(apart.argmin())
        if apart[nearest] <= NEAR_PX:
            return int(shown[rows[nearest], cols[nearest]])
    raise ParamsError("there is no body at that place; click on one of the outlined bodies")


def dropped(masks: np.ndarray, body: int) -> np.ndarray:
    """Without a body. Raises ParamsError where it is the only one."""
    if int(masks.max(initial=0)) == 1:
        raise ParamsError("this is the only body; add another one before you drop it")
    return np.where(masks == body, 0, masks).astype(np.uint8)


def joined(masks: np.ndarray, one: int, other: int) -> np.ndarray:
    """With two bodies as one. Raises ParamsError where they are the same."""
    if one == other:
        raise ParamsError("both clicks are on the same body; click on two bodies to join them")
    return np.where(masks == max(one, other), min(one, other), masks).astype(np.uint8)


def split(masks: np.ndarray, frame: int, first: Point, second: Point) -> np.ndarray:
    """With a body as two: its pixels go to the nearer of two centres, which follow it through the frames.

    Args:
        masks: (T, H, W) uint8.
        frame: Of the clicks.
        first: (x, y) px, in one part.
        second: (x, y) px, in the other part.

    Raises:
        ParamsError: The clicks are not on one body, or at one place.
    """
    body = body_at(masks, frame, first)
    if body_at(masks, frame, second) != body:
        raise ParamsError("the clicks are on two bodies; click on two parts of one body to split it")
    if np.hypot(first[0] - second[0], first[1] - second[1]) < 2:
        raise ParamsError("both clicks are at the same place; click on two parts of the body")
    new = _next_number(masks)
    out = masks.copy()
    for frames in (range(frame, len(masks)), range(frame - 1, -1, -1)):
        centres = np.array([first, second], float)
        for t in frames:
            centres = _part(out[t], body, new, centres)
    return out


def _part(ids: np.ndarray, body: int, new: int, centres: np.ndarray) -> np.ndarray:
    """Give the pixels of a body that are nearer to the second centre the new number; the centres (2, 2) of the parts.

    Where one part has no pixel, as while a body hides it, its centre moves with the other one.
    """
    rows, cols = np.nonzero(ids == body)
    if not len(rows):
        return centres
    places = np.stack([cols, rows], 1) + 0.5
    for _ in range(3):  # as in Lloyd's algorithm, from where the parts were in the frame before
        nearer = np.linalg.norm(places[:, None] - centres, axis=-1).argmin(1)
        there = [k for k in (0, 1) if (nearer == k).any()]
        moved = centres.copy()
        for k in there:
            moved[k] = places[nearer == k].mean(0)
        if len(there) == 1:
            moved[1 - there[0]] += moved[there[0]] - centres[there[0]]
        centres = moved
    ids[rows[nearer == 1], cols[nearer == 1]] = new
    return centres


def added(masks: np.ndarray, body: np.ndarray) -> np.ndarray:
    """With one more body (T, H, W) bool, which takes the pixels of others. Raises ParamsError where it is empty."""
    if not body.any():
        raise ParamsError("no body was found at that place")
    return np.where(body, _next_number(masks), masks).astype(np.uint8)


def _next_number(masks: np.ndarray) -> int:
    """Of another body. Raises ParamsError where masks have no room for one."""
    new = int(masks.max(initial=0)) + 1
    if new > 255:
        raise ParamsError("there are 255 bodies already")
    return new


def outlines(masks: np.ndarray) -> list[list[list[list[int]]]]:
    """Of every frame and body the outline's polygons: [frame][body][polygon] = [x0, y0, x1, y1, …], px."""
    count = int(masks.max(initial=0))
    found = []
    for ids in masks:
        of_frame = []
        for k in range(1, count + 1):
            contours, _ = cv2.findContours((ids == k).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
            of_frame.append([c[:, 0].ravel().tolist() for c in contours])
        found.append(of_frame)
    return found
