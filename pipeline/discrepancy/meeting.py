"""When two bodies met: by the distance between their centres, also where the blow is too weak to show in a track."""

from __future__ import annotations

import numpy as np

LEAST_APPROACH = 0.08  # m/s: bodies that near each other more slowly may lie side by side
SIDE = 4  # samples before and after, from which speeds are taken


def meetings(time: np.ndarray, distance: np.ndarray, reach: float, sigma: float) -> list[float]:
    """Times, s, at which a distance (T,) m between centres stops shrinking within touch, `reach` m; time (T,) s.

    Two samples may lie on either side of the touch, so that half a sample's approach is allowed for.
    """
    out: list[float] = []
    for k in range(1, len(time) - 1):
        before, after = slice(max(0, k - SIDE), k + 1), slice(k, k + SIDE + 1)
        if distance[k] > distance[before].min() or distance[k] > distance[after].min():
            continue
        approach, leave = (_slope(time[s], distance[s]) for s in (before, after))
        error = 2 * sigma / max(time[k] - time[before][0], 1e-9)
        if -approach < LEAST_APPROACH + 2 * error or leave < 0.3 * approach:
            continue
        gap = max(time[k] - time[k - 1], time[k + 1] - time[k])
        if distance[k] < reach - 0.5 * approach * gap + 4 * sigma:
            out.append(float(time[k]))
    return out


def _slope(t: np.ndarray, y: np.ndarray) -> float:
    t = t - t.mean()
    return float((t @ y) / max(t @ t, 1e-12))
