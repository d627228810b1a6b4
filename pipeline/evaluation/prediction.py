"""Forecasts of frames that a fit has not seen, beside two forecasts without physics."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.metrics.extrapolation import at_constant_velocity
from pipeline.metrics.overlap import Counts, assign, count, pair_iou, sequence_iou
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
    early, late = _frames(counts, slice(0, seen)), _frames(counts, slice(seen, None))
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


def _frames(counts: Counts, which: slice) -> Counts:
    return Counts(counts.shared[which], counts.predicted[which], counts.true[which], counts.foreground[which])


def moved_with_replay(own: np.ndarray, masks: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """The frames after `masks`: each instance's last mask, moved and scaled as its object's mask in the replay.

    Args:
        own: (F + M, H, W) the replay's masks.
        masks: (F, H, W) masks of the seen frames.
        pairs: (P, 2) object, instance.

    Returns:
        (M, H, W). Where instance and object are not both visible in the last frame seen: the object's own mask.
    """
    last, later = len(masks) - 1, own[len(masks) :]
    out = np.zeros_like(later)
    for i, j in pairs:
        shape = masks[last] == j + 1
        before, true = _centre_and_size(own[last] == i + 1), _centre_and_size(shape)
        for frame, mask in zip(out, later == i + 1, strict=True):
            now = _centre_and_size(mask)
            if before is None or true is None or now is None:
                frame[mask] = j + 1
                continue
            scale = now[1] / before[1]
            shift = true[0] + now[0] - before[0] - scale * true[0]
            matrix = np.column_stack([scale * np.eye(2), shift])
            moved = cv2.warpAffine(shape.astype(np.uint8), matrix, shape.shape[::-1], flags=cv2.INTER_NEAREST)
            frame[moved > 0] = j + 1
    return out


def _centre_and_size(mask: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centroid (2,) column, row of a mask (H, W) and the square root of its area, px; None where it is empty."""
    rows, columns = np.nonzero(mask)
    return (np.array([columns.mean(), rows.mean()]), float(np.sqrt(len(rows)))) if len(rows) else None
