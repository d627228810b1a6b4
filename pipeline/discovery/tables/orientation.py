"""How the axes of a table lie in the world, by how bodies accelerate: free bodies fall, sliding ones slow down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81  # m/s²
SAMPLES, SECONDS = 11, 0.15  # least window of a parabola; at 60 Hz and 2 mm of noise it tells 0.5 m/s²
LEAST_SAMPLES = 5
FALLS = 0.5  # of gravity: what accelerates more falls; drag takes a part, and a slope of 30° leaves a half
SPEEDS_UP = 0.3  # of gravity: bodies on a level ground get faster by less, whatever it is
ALIKE = 0.8  # share of the windows in which bodies get faster that have to do so in one direction


@dataclass(frozen=True)
class Accelerations:
    """Accelerations in W windows of tracks.

    Attributes:
        acceleration: (W, D) m/s².
        velocity: (W, D) m/s.
    """

    acceleration: np.ndarray
    velocity: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """(D,) m/s², the median over windows."""
        return np.median(self.acceleration, 0)

    @property
    def is_braking(self) -> bool:
        """Whether a common braking against the velocity explains the windows better than a common acceleration."""
        a, v = self.acceleration, self.velocity
        way = v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)
        braking = max(float(np.median(-(a * way).sum(1))), 0.0)
        return bool(np.linalg.norm(a + braking * way, axis=1).mean() < np.linalg.norm(a - self.mean, axis=1).mean())

    def falls(self, axis: int) -> int:
        """1 or -1 where bodies fall along an axis, by the direction; 0 where they do not.

        They fall where their acceleration is that of a fall and no braking, or where they get faster as only falling
        bodies do: at the end of a fall with much drag there is no acceleration.
        """
        mean, a, v = self.mean[axis], self.acceleration[:, axis], self.velocity[:, axis]
        if abs(mean) > FALLS * GRAVITY and not self.is_braking:
            return int(np.sign(mean))
        faster = np.sign(a[(a * v > 0) & (np.abs(a) > SPEEDS_UP * GRAVITY)])
        alike = len(faster) > 0.1 * len(a) and abs(faster.mean()) > 2 * ALIKE - 1
        return int(np.sign(faster.mean())) if alike else 0


def accelerations(tracks: Sequence[tuple[np.ndarray, np.ndarray]]) -> Accelerations | None:
    """From times (T,) s and positions (T, D) m; None where no track is long enough."""
    rows, speeds = [], []
    for time, place in tracks:
        there = np.isfinite(place).all(1) & np.isfinite(time)
        time, place = time[there], place[there]
        if len(time) < LEAST_SAMPLES or not (np.diff(time) > 0).all():
            continue
        size = min(max(SAMPLES, int(SECONDS / np.median(np.diff(time)))), len(time))
        for begin in range(0, len(time) - size + 1, size):
            t = time[begin : begin + size]
            second, first, _ = np.polyfit(t - t.mean(), place[begin : begin + size], 2)
            rows.append(2 * second)
            speeds.append(first)
    return Accelerations(np.array(rows), np.array(speeds)) if rows else None
