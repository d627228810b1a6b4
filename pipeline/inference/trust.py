"""How far an answer can be trusted: a forecast of frames that were not fitted, and a grade with one reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.extrapolation import at_constant_velocity, moved_with_replay
from pipeline.clips.overlap import assign, count, pair_iou, sequence_iou
from pipeline.clips.replay import masks_at
from pipeline.errors import SimulationError
from pipeline.scene.scene import Scene

FITTED_SHARE = 0.7  # of the time in which bodies are in view, from which the rest is forecast
LEAST_FRAMES = 3  # that are forecast
GOOD_IOU, POOR_IOU = 0.7, 0.4  # of the whole clip
OFF_GRAVITY = 0.1  # share by which free fall may differ from gravity
SLOW_MOTION = 1.5  # least factor between frame rates that explains such a difference
GRADES = ("good", "doubtful", "poor")


@dataclass(frozen=True)
class Forecast:
    """How well a scene that was found from the first part of a clip forecasts the rest.

    Attributes:
        from_s: Where the rest begins, s from the clip's beginning.
        iou: Sequence IoU over the rest, of the last masks moved on as the scene's replay moves.
        constant_velocity_iou: That of the last masks moved on at constant velocity.
    """

    from_s: float
    iou: float
    constant_velocity_iou: float

    @property
    def better(self) -> bool:
        """Whether it is better than constant velocity."""
        return self.iou > self.constant_velocity_iou


@dataclass(frozen=True)
class Grade:
    """How far an answer can be trusted.

    Attributes:
        name: Of GRADES.
        reason: One sentence.
    """

    name: str
    reason: str


def fitted_frames(times: np.ndarray, masks: np.ndarray) -> int:
    """How many frames are fitted before the rest is forecast; 0 where too few are left.

    Args:
        times: (T,) s.
        masks: (T, H, W) ids. What is forecast has to be in view: frames after the last one with a body do not count.
    """
    seen = np.flatnonzero(masks.any(axis=(1, 2)))
    if not len(seen):
        return 0
    last = int(seen[-1])
    first = int(np.searchsorted(times, times[0] + FITTED_SHARE * (times[last] - times[0])))
    return first if last + 1 - first >= LEAST_FRAMES else 0


def forecast(scene: Scene, masks: np.ndarray, times: np.ndarray, seen: int) -> Forecast | None:
    """Score a scene that was found from the first part of a clip on the rest.

    Its motion is scored: the last mask of each body before the rest is carried on as the replay moves, and for
    comparison at constant velocity.

    Args:
        scene: What was found.
        masks: (T, H, W) ids of the whole clip; bodies without an object count as missed.
        times: (T,) s.
        seen: Frames that were fitted.

    Returns:
        The scores; None where the scene cannot be simulated, or no body is seen in the rest.
    """
    height, width = masks.shape[1:]
    try:
        own = masks_at(scene, times - times[0], width, height)
    except SimulationError:
        return None
    instances = int(masks.max())
    counts = count(own, masks, len(scene.objects), instances)
    pairs = assign(pair_iou(counts.frames(slice(0, seen))))
    rate = (len(times) - 1) / float(times[-1] - times[0])
    moved = at_constant_velocity(masks[:seen], len(masks) - seen, rate)
    same = np.stack([np.arange(instances)] * 2, 1)
    told = moved_with_replay(own, masks[:seen], pairs)
    iou, rival = (float(sequence_iou(count(m, masks[seen:], instances, instances), same)) for m in (told, moved))
    if not np.isfinite(iou) or not np.isfinite(rival):  # no body is seen in the rest
        return None
    return Forecast(from_s=float(times[seen] - times[0]), iou=iou, constant_velocity_iou=rival)


def gravity_doubt(found: float, expected: float, error: float, fps: float) -> str | None:
    """A sentence on free fall that disagrees with gravity at a known scale; None where it agrees.

    Args:
        found: m/s², of what falls, by the length or size that is known.
        expected: m/s².
        error: Standard error of `found`, as a share.
        fps: Frames a second that were assumed.
    """
    if abs(found / expected - 1) <= max(OFF_GRAVITY, 3 * error):
        return None
    told = f"bodies fall with {found:.3g} m/s² at the length or size that was given, not {expected:.3g}"
    slow = (expected / found) ** 0.5
    if slow > SLOW_MOTION:
        return f"{told}: it would fit if the film was shot at {fps * slow:.0f} frames a second (--fps)"
    return f"{told}: the length may be wrong or not in the plane of motion, or the air brakes what falls"


def grade(sequence_iou: float, told: Forecast | None) -> Grade:
    """The grade of an answer.

    Args:
        sequence_iou: Of its replay with the clip's masks.
        told: How well a scene from the first part of the clip forecasts the rest; None where that could not be tried.
    """
    if sequence_iou < POOR_IOU:
        return Grade("poor", f"the replay overlaps little of what moves in the clip (IoU {sequence_iou:.2f})")
    if told is None:
        return Grade("doubtful", "the answer could not be tested on frames that were not fitted")
    against = f"IoU {told.iou:.2f} from {told.from_s:.2f} s on, constant velocity {told.constant_velocity_iou:.2f}"
    if not told.better:
        return Grade(
            "doubtful", f"frames that were not fitted are not forecast better than by constant velocity ({against})"
        )
    if sequence_iou < GOOD_IOU:
        return Grade("doubtful", f"the replay follows the clip in part only (IoU {sequence_iou:.2f})")
    well = "" if told.iou >= POOR_IOU else ", though not well"
    return Grade("good", f"frames that were not fitted are forecast better than by constant velocity{well} ({against})")
