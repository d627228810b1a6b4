"""How the axes of a table lie in the world, by how bodies accelerate: free bodies fall, sliding ones slow down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81  # m/s²
WINDOW = 11  # samples of a parabola: at 60 Hz and 2 mm of noise it tells an acceleration to 0.5 m/s²
FALLS = 0.5  # of gravity: what accelerates more in one direction falls; drag takes a part, a slope of 30° has half
RESTS = 0.03  # of gravity: less is no acceleration


@dataclass(frozen=True)
class Acceleration:
    """The acceleration that windows of the tracks have in common.

    Attributes:
        mean: (D,) m/s², median over windows.
        constant_misfit: Mean distance of the windows' accelerations from it, m/s².
        braking_misfit: From a common braking against each window's velocity, m/s².
    """

    mean: np.ndarray
    constant_misfit: float
    braking_misfit: float

    def falls(self, axis: int) -> bool:
        """Whether bodies fall along an axis, one way or the other, and do not merely slow down along it."""
        size = abs(self.mean[axis]) / GRAVITY
        if size < RESTS:
            return False
        if self.braking_misfit < 0.9 * self.constant_misfit:
            return False
        return size > (0.7 if self.braking_misfit < 1.1 * self.constant_misfit else FALLS)


def acceleration(tracks: Sequence[tuple[np.ndarray, np.ndarray]]) -> Acceleration | None:
    """From times (T,) s and positions (T, D) m; None where no track has a window of samples."""
    rows, speeds = [], []
    for time, place in tracks:
        there = np.isfinite(place).all(1) & np.isfinite(time)
        time, place = time[there], place[there]
        for begin in range(0, len(time) - WINDOW + 1, WINDOW):
            t, x = time[begin : begin + WINDOW], place[begin : begin + WINDOW]
            if (np.diff(t) > 0).all():
                second, first, _ = np.polyfit(t - t.mean(), x, 2)
                rows.append(2 * second)
                speeds.append(first)
    if not rows:
        return None
    a, v = np.array(rows), np.array(speeds)
    mean = np.median(a, 0)
    way = v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)
    braking = max(float(np.median(-(a * way).sum(1))), 0.0)
    return Acceleration(
        mean,
        float(np.linalg.norm(a - mean, axis=1).mean()),
        float(np.linalg.norm(a + braking * way, axis=1).mean()),
    )
