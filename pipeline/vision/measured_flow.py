"""Flow of a recording's pairs of frames per nominal interval, whatever its frame rate was."""

from __future__ import annotations

import numpy as np

from pipeline.vision.dis import DIS
from pipeline.vision.raft import RAFT


def measured_flow(
    estimator: RAFT | DIS, frames: np.ndarray, recorded: np.ndarray, pairs: np.ndarray, interval: float,
    iterations: int, size: tuple[int, int],
) -> np.ndarray:  # fmt: skip
    """Flow (P, H, W, 2) float32, px of frames (T, H, W, 3) uint8 per `interval`, s, of pairs (P, 2) of frames.

    recorded: (T,) s, when each frame was recorded. iterations, size: the estimator's, (width, height) px.
    """
    first, second, scale = recorded_pairs(recorded, pairs, interval)
    flow = estimator.flow(frames[first], frames[second], iterations, size=size)
    return flow * scale.astype(np.float32)[:, None, None, None]


def recorded_pairs(
    recorded: np.ndarray, pairs: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames between which the flow of pairs (P, 2) is measured, and by what it is multiplied to be per `interval`, s.

    recorded: (T,) s, when each frame was recorded. At a low or uneven frame rate a frame may repeat the one before,
    which would be no motion: then the next one that differs is taken, or at the end the one before.
    """
    first, second = pairs[:, 0].copy(), pairs[:, 1].copy()
    last = len(recorded) - 1
    for k in range(len(pairs)):
        while second[k] < last and recorded[second[k]] <= recorded[first[k]]:
            second[k] += 1
        while first[k] > 0 and recorded[second[k]] <= recorded[first[k]]:
            first[k] -= 1
    between = recorded[second] - recorded[first]
    return first, second, np.where(between > 0, interval / np.maximum(between, 1e-9), 0.0)
