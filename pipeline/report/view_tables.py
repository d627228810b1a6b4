"""Tables of the scenes that were found in clips as people film them. Light to import, unlike what finds the scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.inference.trust import GOOD_IOU
from pipeline.report.markdown import markdown


@dataclass(frozen=True)
class ViewScore:
    """What was found in one clip. Errors in deg; NaN where they do not apply.

    Attributes:
        clip: Its number.
        kind: True view.
        shapes: True composition.
        found: View that was found.
        iou: Sequence IoU of the replay; 0 where no scene was found.
        roll_error: Of the camera.
        slope_error: Of the ramp.
        by: What found the scene: "tracks" or "search".
        grade: Of the answer.
        beats_constant_velocity: Its forecast is better than that.
    """

    clip: int
    kind: str
    shapes: str
    found: str
    iou: float
    roll_error: float
    slope_error: float
    by: str
    grade: str
    beats_constant_velocity: bool

    @property
    def view_right(self) -> bool:
        """A throw is seen from the side, too."""
        return self.found == self.kind or {self.found, self.kind} == {"side", "flight"}

    @property
    def trusted_rightly(self) -> bool:
        """Whether it deserves to be graded good."""
        return self.iou >= GOOD_IOU and self.beats_constant_velocity


def clips_table(scores: Sequence[ViewScore]) -> str:
    """Markdown: a row for each clip."""
    head = ("clip", "kind", "shapes", "found", "IoU", "roll error", "slope error", "by", "grade")
    numbers = ([f"{s.iou:.2f}", f"{s.roll_error:.1f}", f"{s.slope_error:.1f}"] for s in scores)
    rows = [[f"{s.clip}", s.kind, s.shapes, s.found, *n, s.by, s.grade] for s, n in zip(scores, numbers, strict=True)]
    return markdown(head, rows)


def kinds_table(scores: Sequence[ViewScore]) -> str:
    """Markdown: a row for each kind of view, and one for all; below, how far grades are right."""
    head, rows = ("kind", "clips", "view right", "IoU", "roll error, median", "slope error, median"), []
    for kind in (*sorted({s.kind for s in scores}), "all"):
        own = [s for s in scores if kind in (s.kind, "all")]
        errors = [_median([abs(e) for e in values]) for values in _errors(own)]
        iou, right = float(np.mean([s.iou for s in own])), sum(s.view_right for s in own)
        rows.append([kind, f"{len(own)}", f"{right}", f"{iou:.2f}", f"{errors[0]:.1f}", f"{errors[1]:.1f}"])
    good = [s for s in scores if s.grade == "good"]
    told = f"Good: {len(good)} of {len(scores)}, of which {sum(s.trusted_rightly for s in good)} have an IoU of at "
    return f"{markdown(head, rows)}\n{told}least {GOOD_IOU} and beat constant velocity.\n"


def figures(scores: Sequence[ViewScore]) -> dict[str, float | None]:
    """Means over clips, as a metric of the graph."""
    roll, slope = (_median([abs(e) for e in values]) for values in _errors(scores))
    good = [s for s in scores if s.grade == "good"]
    if not scores:
        return {"clips": 0}
    return {
        "clips": len(scores),
        "view_right": _figure(float(np.mean([s.view_right for s in scores]))),
        "iou": _figure(float(np.mean([s.iou for s in scores]))),
        "roll_error_deg": _figure(roll),
        "slope_error_deg": _figure(slope),
        "good": _figure(len(good) / len(scores)),
        "good_rightly": _figure(float(np.mean([s.trusted_rightly for s in good])) if good else np.nan),
    }


def _errors(scores: Sequence[ViewScore]) -> tuple[list[float], list[float]]:
    """Roll and slope errors, deg, where they apply."""
    every = [s.roll_error for s in scores], [s.slope_error for s in scores]
    roll, slope = ([e for e in values if not np.isnan(e)] for values in every)
    return roll, slope


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _figure(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None
