"""Scores of scenes that were found without a model, by tracks or by the search, in clips as people film them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.clips.schedule import Schedule
from pipeline.inference.filmed_world import TrackedScene, World, follow, tracked_scene
from pipeline.inference.method import SEARCH, TRACKS, explains, replay_overlap, ways
from pipeline.inference.scene_search import clip_evaluator, search_clip, search_forecast
from pipeline.inference.trust import GOOD_IOU, grade
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.camera import pinhole

UPRIGHT = ("side", "incline", "flight")  # views in which the camera's roll counts
STEEPEST_DEG = 60.0  # of a fixed body's slope that is a ramp's


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


def true_roll(scene: Scene) -> float:
    """deg, by which the world's vertical is turned in the picture, clockwise."""
    assert scene.camera is not None
    right, up, _ = pinhole(scene.camera).rotation_world.T
    return float(np.degrees(np.arctan2(right[2], up[2])))


def steepest(scene: Scene) -> float:
    """deg, the slope in the picture's plane of the steepest ramp."""
    slopes = [
        Rotation.from_quat(b.orientation, scalar_first=True).as_euler("yxz", degrees=True)[0] for b in scene.fixed
    ]
    return max((abs(float(s)) for s in slopes if abs(s) < STEEPEST_DEG), default=0.0)


@dataclass(frozen=True)
class SeenClip:
    """A clip whose scene is looked for.

    Attributes:
        masks: (T, H, W) true ids.
        frames: (T, H, W, 3) uint8 RGB.
        flow: (P, H, W, 2) px, of the model's pairs of frames.
        schedule: Of the frames.
    """

    masks: np.ndarray
    frames: np.ndarray
    flow: np.ndarray
    schedule: Schedule


def view_score(
    clip: int, kind: str, truth: Scene, seen: SeenClip, *, size: tuple[int, int], simulations: int
) -> ViewScore:
    """Find the scene of a clip from its tracks, by the search, or by both (`pipeline.inference.method.ways`); score it.

    Args:
        clip: Its number.
        kind: True view.
        truth: True scene.
        seen: What is known of the clip.
        size: px, width and height, of masks and flow in the search.
        simulations: Of the search; 0: there is none.
    """
    fps = seen.schedule.fps
    followed = follow(seen.masks, seen.frames, np.arange(len(seen.masks)) / fps, World())
    view = followed.motion.view
    scene, iou, by, told = None, 0.0, TRACKS, TrackedScene(None, None)
    for way in ways(view.kind, simulations, World().measured):
        if way == TRACKS:
            told = tracked_scene(followed)
            found = None if told.answer is None else told.answer.scene
        else:
            evaluator = clip_evaluator(seen.masks, seen.flow, seen.schedule, size, 1, seen.frames)
            found = search_clip(evaluator, [], simulations, np.random.default_rng(clip)).result.scene
        reached = 0.0 if found is None else replay_overlap(found, seen.masks, fps).sequence
        if reached > iou:
            scene, iou, by = found, reached, way
        if explains(view.kind, reached):
            break
    ahead = told.forecast
    if by == SEARCH:
        ahead = search_forecast(
            seen.masks,
            seen.flow,
            seen.schedule,
            [],
            size=size,
            simulations=simulations,
            seed=clip,
            incline=False,
            threads=1,
        )
    slope = steepest(scene) - steepest(truth) if scene is not None and kind == "incline" else np.nan
    return ViewScore(
        clip=clip,
        kind=kind,
        shapes=truth.composition,
        found=view.kind,
        iou=iou,
        roll_error=view.roll_deg - true_roll(truth) if kind in UPRIGHT else np.nan,
        slope_error=slope,
        by=by,
        grade=grade(iou, ahead).name,
        beats_constant_velocity=ahead is not None and ahead.better,
    )


def clip_line(score: ViewScore) -> str:
    """A row of the table with this heading."""
    s = score
    return (
        f"| {s.clip} | {s.kind} | {s.shapes} | {s.found} | {s.iou:.2f} | {s.roll_error:.1f} | {s.slope_error:.1f} | "
        f"{s.by} | {s.grade} |"
    )


CLIP_HEADING = "| clip | kind | shapes | found | IoU | roll error | slope error | by | grade |\n" + "| --- " * 9 + "|"
KIND_HEADING = "| kind | clips | view right | IoU | roll error, median | slope error, median |\n" + "| --- " * 6 + "|"


def kinds_table(scores: Sequence[ViewScore]) -> str:
    """Markdown: a row for each kind of view, and one for all; below, how far grades are right."""
    lines = [KIND_HEADING]
    for kind in (*sorted({s.kind for s in scores}), "all"):
        own = [s for s in scores if kind in (s.kind, "all")]
        errors = [_median([abs(e) for e in values]) for values in _errors(own)]
        iou, right = float(np.mean([s.iou for s in own])), sum(s.view_right for s in own)
        lines.append(f"| {kind} | {len(own)} | {right} | {iou:.2f} | {errors[0]:.1f} | {errors[1]:.1f} |")
    good = [s for s in scores if s.grade == "good"]
    told = f"Good: {len(good)} of {len(scores)}, of which {sum(s.trusted_rightly for s in good)} have an IoU of at "
    return "\n".join([*lines, "", told + f"least {GOOD_IOU} and beat constant velocity.", ""])


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
