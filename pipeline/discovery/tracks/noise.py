"""The noise of positions, estimated from the positions alone."""

from __future__ import annotations

import numpy as np

MAD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
LEAST = 1e-7  # m: no measurement is exact


def leave_one_out(time: np.ndarray, position: np.ndarray, lag: int = 1) -> np.ndarray:
    """Each sample minus the cubic through its four neighbours, scaled so that white noise keeps its standard deviation.

    Args:
        time: (T,) s.
        position: (T, 3) m.
        lag: Of the neighbours, samples.

    Returns:
        (T, 3), NaN for the 2 `lag` samples at each end.
    """
    out = np.full(position.shape, np.nan)
    if len(time) < 4 * lag + 1:
        return out
    inner = slice(2 * lag, len(time) - 2 * lag)
    around = np.arange(len(time))[inner, None] + lag * np.array([-2, -1, 1, 2])  # (T - 4 lag, 4)
    t, here = time[around], time[inner]
    weights = np.ones(t.shape)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[:, i] *= (here - t[:, j]) / (t[:, i] - t[:, j])
    predicted = np.einsum("tk,tkc->tc", weights, position[around])
    out[inner] = (position[inner] - predicted) / np.sqrt(1 + (weights**2).sum(1))[:, None]
    return out


def rough_sigma(residuals: np.ndarray) -> float:
    """Standard deviation of the residuals of `leave_one_out`, robust to impacts and outliers.

    Coordinates that do not move at all (a two-dimensional recording) do not count.
    """
    kept = residuals[np.isfinite(residuals)]
    kept = kept[np.abs(kept) > 1e-12]
    return max(float(MAD * np.median(np.abs(kept))), LEAST) if len(kept) else LEAST


def correlation(residuals: list[np.ndarray], parameters: int) -> float:
    """Lag-one autocorrelation of residuals, a list of (n, 3); at least 0.

    Corrected for the number of fitted parameters: residuals of white noise look anticorrelated by about parameters /
    samples after a fit.
    """
    products = sum(float((r[1:] * r[:-1]).sum()) for r in residuals)
    squares = sum(float((r * r).sum()) for r in residuals)
    count = sum(r.size for r in residuals)
    if squares == 0:
        return 0.0
    bias = -parameters / max(count, 1)
    value = products / squares - bias
    return float(np.clip(value if value > 3 / np.sqrt(max(count, 1)) else 0.0, 0.0, 0.98))
