"""Forecasts of frames that a fit has not seen, beside two forecasts without physics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.extrapolation import at_constant_velocity, moved_with_replay
from pipeline.clips.overlap import assign, count, pair_iou, sequence_iou
from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class ForecastScores:
    """Sequence IoU of four forecasts over the unseen frames, and of the replay over the seen ones.

    Attributes:
        search: The scene's replay.
        moved_with_replay: The last masks seen, moved as the replay moves.
        constant_velocity: The last masks seen, moved at their last velocity.
        frozen: The last masks seen, at rest.
        seen: The scene's replay, over the seen frames.
    """

    search: float
    moved_with_replay: float
    constant_velocity: float
    frozen: float
    seen: float


def forecast_scores(scene: Scene, masks: np.ndarray, seen: int, schedule: Schedule) -> ForecastScores:
    """How well a scene found from the first frames of a clip forecasts the others.

    Args:
        scene: The scene found. Its objects are assigned to instances by the seen frames.
        masks: (F, H, W) uint8, true masks of all frames at 480x320.
        seen: How many frames the fit saw.
        schedule: Of the whole clip.

    Raises:
        SimulationError: The replay diverges.
    """
    instances = int(masks.max(initial=0))
    own = replay_poses(scene, schedule).masks
    counts = count(own, masks, len(scene.objects), instances)
    early, late = counts.frames(slice(0, seen)), counts.frames(slice(seen, None))
    pairs = assign(pair_iou(early))
    same = np.stack([np.arange(instances)] * 2, 1)

    def score(predicted: np.ndarray) -> float:
        return float(sequence_iou(count(predicted, masks[seen:], instances, instances), same))

    return ForecastScores(
        search=float(sequence_iou(late, pairs)),
        moved_with_replay=score(moved_with_replay(own, masks[:seen], pairs)),
        constant_velocity=score(at_constant_velocity(masks[:seen], len(masks) - seen, schedule.fps)),
        frozen=score(np.repeat(masks[seen - 1 : seen], len(masks) - seen, axis=0)),
        seen=float(sequence_iou(early, pairs)),
    )
