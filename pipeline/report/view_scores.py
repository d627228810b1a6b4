"""Scores of scenes that were found without a model, by tracks or by the search, in clips as people film them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.clips.schedule import Schedule
from pipeline.inference.filmed_world import World, fitted_scene, follow, forecast_scene
from pipeline.inference.method import AMBIGUITY_MARGIN, EXPLAINS_IOU, SEARCH, TRACKS, is_ambiguous, replay_overlap, ways
from pipeline.inference.scene_search import clip_evaluator, search_clip, search_forecast
from pipeline.inference.trust import grade
from pipeline.report.view_tables import ViewScore
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.camera import pinhole
from pipeline.worlds.view import UPRIGHT

STEEPEST_DEG = 60.0  # of a fixed body's slope that is a ramp's


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
    times = seen.schedule.times
    followed = follow(seen.masks, seen.frames, times, World())
    view = followed.motion.view
    scene, iou, merit, by, answer, ahead = None, 0.0, 0.0, TRACKS, None, None
    ambiguous = simulations > 0 and is_ambiguous(view, World())
    for way in ways(view.kind, simulations, World().measured):
        if way == TRACKS:
            answer = fitted_scene(followed)
            if answer is not None:
                answer, ahead = forecast_scene(followed, answer)
            found = None if answer is None else answer.scene
        else:
            evaluator = clip_evaluator(seen.masks, seen.flow, seen.schedule, size, 1, seen.frames)
            found = search_clip(evaluator, [], simulations, np.random.default_rng(clip)).result.scene
        reached = 0.0 if found is None else replay_overlap(found, seen.masks, times).sequence
        less = AMBIGUITY_MARGIN if way == TRACKS and ambiguous else 0.0
        if reached - less > merit:
            scene, iou, merit, by = found, reached, reached - less, way
        if reached >= EXPLAINS_IOU and not less:
            break
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
