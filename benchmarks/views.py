"""Sampled scenes as people film them, from true masks: is the view right, and does the scene follow the clip?

    python -m benchmarks.views [--clips 40] [--seed 11] [--only KIND ...]

Scenes: pipeline/scene/sample_views.py; pictures: the ray caster's with a random appearance. Only tracks are used, no
model and no search: of a table, that finds balls only.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.clips.draw_views import draw_view_clips, view_kind
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.inference.filmed_world import TrackedWorld, World, tracked_world
from pipeline.inference.trust import Grade, grade
from pipeline.metrics.overlap import overlap
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import sample_appearance
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.render import render_rgb

SUITE = "views benchmark"
SCHEDULE = Schedule()


@dataclass(frozen=True)
class ViewClip:
    """A sampled clip: its scene, masks (T, H, W) and frames (T, H, W, 3)."""

    scene: Scene
    masks: np.ndarray
    frames: np.ndarray


def view_clip(seed: int, index: int) -> ViewClip:
    """The clip with this index."""
    (scene,) = draw_view_clips(seed, SUITE, [index], SCHEDULE).scenes
    shown = replay_poses(scene, SCHEDULE)
    rng = np.random.default_rng([seed, index])
    appearance = sample_appearance(rng, len(scene.objects), n_fixed=len(scene.fixed))
    frames = render_rgb(scene, shown.position, shown.quaternion, appearance, shown.width, shown.height, "raycast")
    return ViewClip(scene, shown.masks, frames)


def true_roll(scene: Scene) -> float:
    """deg, by which the world's vertical is turned in the picture, clockwise."""
    assert scene.camera is not None
    right, up, _ = pinhole(scene.camera).rotation_world.T
    return float(np.degrees(np.arctan2(right[2], up[2])))


def steepest(scene: Scene) -> float:
    """deg, the slope in the picture's plane of the steepest fixed body."""
    slopes = [
        Rotation.from_quat(b.orientation, scalar_first=True).as_euler("yxz", degrees=True)[0] for b in scene.fixed
    ]
    return max((abs(float(s)) for s in slopes if abs(s) < 60), default=0.0)


def same_view(found: str, true: str) -> bool:
    return found == true or {found, true} == {"side", "flight"}


@dataclass(frozen=True)
class Outcome:
    """What was found in one clip. Errors in deg; NaN where they do not apply."""

    kind: str
    found: str
    iou: float
    roll_error: float
    slope_error: float
    grade: Grade
    beats_constant_velocity: bool


def outcome(index: int, clip: ViewClip) -> Outcome:
    times = np.arange(len(clip.masks)) / SCHEDULE.fps
    told: TrackedWorld = tracked_world(clip.masks, clip.frames, times, World())
    kind, iou, slope = view_kind(index), 0.0, np.nan
    if told.answer is not None:
        scene, (height, width) = told.answer.scene, clip.masks.shape[1:]
        try:
            own = masks_at(scene, times, width, height)
            iou = overlap(own, clip.masks, len(scene.objects), len(clip.scene.objects)).sequence
        except SimulationError:
            pass
        if kind == "incline":
            slope = steepest(scene) - steepest(clip.scene)
    ahead = told.forecast is not None and told.forecast.iou > told.forecast.constant_velocity_iou
    view = told.motion.view
    roll = view.roll_deg - true_roll(clip.scene) if kind in ("side", "incline", "flight") else np.nan
    return Outcome(
        kind=kind,
        found=view.kind,
        iou=iou,
        roll_error=roll,
        slope_error=slope,
        grade=grade(iou, told.forecast),
        beats_constant_velocity=ahead,
    )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args(argv)
    print("| clip | kind | shapes | found | IoU | roll error | slope error | grade |\n" + "| --- " * 8 + "|")
    outcomes = []
    for index in range(arguments.clips):
        if arguments.only and view_kind(index) not in arguments.only:
            continue
        clip = view_clip(arguments.seed, index)
        found = outcome(index, clip)
        outcomes.append(found)
        print(
            f"| {index} | {found.kind} | {clip.scene.composition} | {found.found} | {found.iou:.2f} | "
            f"{found.roll_error:.1f} | {found.slope_error:.1f} | {found.grade.name} |",
            flush=True,
        )
    print("\n| kind | clips | view right | IoU | roll error, median | slope error, median |\n" + "| --- " * 6 + "|")
    for kind in (*sorted({o.kind for o in outcomes}), "all"):
        own = [o for o in outcomes if kind in (o.kind, "all")]
        right = sum(same_view(o.found, o.kind) for o in own)
        errors = [
            np.nanmedian(np.abs([*e, np.nan])) if len(e) else np.nan
            for e in (
                [o.roll_error for o in own if not np.isnan(o.roll_error)],
                [o.slope_error for o in own if not np.isnan(o.slope_error)],
            )
        ]
        iou = np.mean([o.iou for o in own])
        print(f"| {kind} | {len(own)} | {right} | {iou:.2f} | {errors[0]:.1f} | {errors[1]:.1f} |")
    good = [o for o in outcomes if o.grade.name == "good"]
    sure = sum(o.iou >= 0.7 and o.beats_constant_velocity for o in good)
    print(f"\ngood: {len(good)} of {len(outcomes)}, of which {sure} have IoU >= 0.7 and beat constant velocity")


if __name__ == "__main__":
    main()
