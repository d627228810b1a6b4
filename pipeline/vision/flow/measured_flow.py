"""Flow between pairs of frames of a recording, scaled to a nominal interval. Frame rates may be low or uneven."""

from __future__ import annotations

import numpy as np

from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import RAFT


def measured_flow(
    estimator: RAFT | DIS,
    frames: np.ndarray,
    recorded: np.ndarray,
    pairs: np.ndarray,
    interval: float,
    iterations: int,
    size: tuple[int, int],
) -> np.ndarray:
    """Flow of pairs of frames per interval.

    Args:
        estimator: RAFT or DIS.
        frames: (T, H, W, 3) uint8 RGB.
        recorded: (T,), when each frame was recorded, s.
        pairs: (P, 2) indices of frames.
        interval: Nominal interval, s.
        iterations: Of the estimator.
        size: Working size (width, height) of the estimator, px.

    Returns:
        (P, H, W, 2) float32, px of the given frames per interval.
    """
    first, second, scale = recorded_pairs(recorded, pairs, interval)
    flow = estimator.flow(frames[first], frames[second], iterations, size=size)
    return flow * scale.astype(np.float32)[:, None, None, None]


def recorded_pairs(
    recorded: np.ndarray, pairs: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames between which the flow of each pair is measured, and the factor that scales it to the interval.

    At a low or uneven frame rate a frame may repeat the one before, which would show no motion. Then the second frame
    is the next one that differs or, at the end, the first frame is an earlier one.

    Args:
        recorded: (T,), when each frame was recorded, s.
        pairs: (P, 2) indices of frames.
        interval: Nominal interval, s.

    Returns:
        First frames (P,), second frames (P,), and factors (P,), 0 where all frames are equal.
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
