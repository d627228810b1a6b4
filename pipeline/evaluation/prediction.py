"""Prediction of frames that a fit has not seen, beside two ways to predict without any physics."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.metrics.overlap import Counts, assign, count, pair_iou, sequence_iou
from pipeline.scene.scene import Scene

TRACK_SECONDS = 0.2  # before the last frame seen, over which an instance's velocity is measured


@dataclass(frozen=True)
class Prediction:
    """Sequence IoU over the unseen frames: of a scene's replay, of the last masks seen moved as that replay moves, of
    masks that move on at constant velocity, and of masks that stay; and that of the replay over the seen frames."""

    search: float
    carried: float
    velocity: float
    frozen: float
    seen: float


def predict(scene: Scene, masks: np.ndarray, seen: int, schedule: Schedule) -> Prediction:
    """How well what was found from the first `seen` frames of a clip foretells the others.

    masks (F, H, W) uint8 of all frames, at 480x320. Objects are assigned to instances by the seen frames. Raises
    `SimulationError` where the replay goes bad.
    """
    instances = int(masks.max(initial=0))
    own = replay_poses(scene, schedule).masks
    counts = count(own, masks, len(scene.objects), instances)
    early, late = _frames(counts, slice(0, seen)), _frames(counts, slice(seen, None))
    pairs = assign(pair_iou(early))
    same = np.stack([np.arange(instances)] * 2, 1)

    def score(predicted: np.ndarray) -> float:
        return float(sequence_iou(count(predicted, masks[seen:], instances, instances), same))

    frozen = np.repeat(masks[seen - 1 : seen], len(masks) - seen, axis=0)
    return Prediction(
        float(sequence_iou(late, pairs)),
        score(carried(own, masks[:seen], pairs)),
        score(moved_on(masks[:seen], len(masks) - seen, schedule.fps)),
        score(frozen),
        float(sequence_iou(early, pairs)),
    )


def _frames(counts: Counts, which: slice) -> Counts:
    return Counts(counts.shared[which], counts.predicted[which], counts.true[which], counts.foreground[which])


def carried(own: np.ndarray, masks: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """The frames after masks (F, H, W): each instance's last mask, moved and grown as the mask of its object (pairs
    (P, 2): object, instance) moves and grows in a replay's masks `own` (F + more, H, W); where the two are not both
    seen in the last frame, the object's own mask."""
    last, later = len(masks) - 1, own[len(masks) :]
    out = np.zeros_like(later)
    for i, j in pairs:
        shape = masks[last] == j + 1
        was, true = _place(own[last] == i + 1), _place(shape)
        for frame, mask in zip(out, later == i + 1, strict=True):
            now = _place(mask)
            if was is None or true is None or now is None:
                frame[mask] = j + 1
                continue
            grown = now[1] / was[1]
            shift = true[0] + now[0] - was[0] - grown * true[0]
            matrix = np.column_stack([grown * np.eye(2), shift])
            moved = cv2.warpAffine(shape.astype(np.uint8), matrix, shape.shape[::-1], flags=cv2.INTER_NEAREST)
            frame[moved > 0] = j + 1
    return out


def _place(mask: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centroid (2,) column, row of a mask (H, W) and the root of its area, px; None where it is empty."""
    rows, columns = np.nonzero(mask)
    return (np.array([columns.mean(), rows.mean()]), float(np.sqrt(len(rows)))) if len(rows) else None


def moved_on(masks: np.ndarray, more: int, fps: float) -> np.ndarray:
    """The next `more` frames (more, H, W) of masks (F, H, W): each instance's last mask, moved at the velocity that its
    centroid had, in px. Of two on one pixel the one with the higher number is seen."""
    out = np.zeros((more, *masks.shape[1:]), np.uint8)
    steps = max(2, round(TRACK_SECONDS * fps) + 1)
    for instance in range(1, int(masks.max(initial=0)) + 1):
        frames = [k for k in range(len(masks)) if (masks[k] == instance).any()]
        if not frames:
            continue
        recent = [k for k in frames if k > frames[-1] - steps]
        places = np.array([np.argwhere(masks[k] == instance).mean(0) for k in recent])  # (T, 2) row, column
        velocity = np.polyfit(recent, places, 1)[0] if len(recent) > 1 else np.zeros(2)
        last = np.argwhere(masks[frames[-1]] == instance)
        for k in range(more):
            shift = velocity * (len(masks) + k - frames[-1])
            rows, columns = np.rint(last + shift).astype(int).T
            inside = (rows >= 0) & (rows < masks.shape[1]) & (columns >= 0) & (columns < masks.shape[2])
            out[k, rows[inside], columns[inside]] = instance
    return out
