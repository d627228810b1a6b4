"""The noise of measured columns, estimated from the columns alone."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.tracks.noise import MAD

ORDERS = range(2, 11)
LEAST_DIFFERENCES = 8
LEAST = 1e-9


def channel_noise(log: Log) -> np.ndarray:
    """Standard deviation of each column, (C,), in its unit: as given, else from its differences.

    The k-th difference of a smooth motion shrinks with k, that of white noise grows as the root of (2k over k) (the
    variate difference method, Anderson 1929). The order that shows the least noise is taken; a median is robust to
    impacts and outliers. Of unequal times, differences are divided ones.
    """
    given = [c.sigma for c in log.clips if c.sigma is not None]
    if given and np.isfinite(np.concatenate(given)).any():
        return np.full(len(log.channels), float(np.nanmedian(np.concatenate(given))))
    out = []
    for column in range(len(log.channels)):
        levels = []
        for order in ORDERS:
            parts = [_differences(c.time, c.values[:, column], order) for c in log.clips]
            every = np.concatenate(parts)
            if len(every) >= LEAST_DIFFERENCES:
                levels.append(MAD * float(np.median(np.abs(every))))
        spread = float(np.nanstd(np.concatenate([c.values[:, column] for c in log.clips])))
        out.append(max(min(levels, default=1e-3 * spread), LEAST))
    return np.array(out)


def _differences(time: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """Divided differences of an order, scaled so that white noise keeps its standard deviation."""
    there = np.isfinite(values)
    t, y = time[there], values[there]
    if len(t) <= order:
        return np.zeros(0)
    t = np.lib.stride_tricks.sliding_window_view(t, order + 1)
    y = np.lib.stride_tricks.sliding_window_view(y, order + 1)
    t = (t - t[:, :1]) / np.maximum(t[:, -1:] - t[:, :1], 1e-12)  # of size 1: products of small steps would underflow
    apart = t[:, :, None] - t[:, None, :]
    weight = 1 / (apart + np.eye(order + 1)).prod(2)
    weight /= np.sqrt((weight**2).sum(1, keepdims=True))
    return np.asarray((weight * y).sum(1))
