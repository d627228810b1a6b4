"""Single samples of a track that are far from where the samples around them say they should be."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np

LIMIT = 5.0  # standard deviations from the prediction
SMOOTH = 3.0  # largest residual, in standard deviations, of five samples that lie on a parabola
SIDE = 5  # samples on each side that predict one
AROUND = ((1, 3), (2, 2), (3, 1))  # samples before and after one that predict it, too, since a hop may be short


def find_outliers(time: np.ndarray, position: np.ndarray, sigma: float) -> np.ndarray:
    """Samples that neither the samples before, nor those after, nor those around them predict, (T,) bool.

    A sample at an impact agrees with one side, one in a short hop with its neighbours; an outlier agrees with none. A
    prediction is the median of the parabolas through all triples of some samples, so that an outlier among them does
    no harm.
    """
    bad = np.zeros(len(time), bool)
    for _ in range(SIDE + 1):  # repeated without those found: a side that contains outliers predicts badly
        new = np.array([_is_outlier(time, position, bad, k, sigma) for k in range(len(time))]) & ~bad
        if not new.any():
            break
        bad |= new
    return bad


def _is_outlier(time: np.ndarray, position: np.ndarray, bad: np.ndarray, k: int, sigma: float) -> bool:
    """Whether sample k is too far from each prediction.

    Near an end of the track there is one side only. It must itself be smooth, else the velocity may jump there.
    """
    before, after = (inwards[~bad[inwards]] for inwards in (np.arange(k - 1, -1, -1), np.arange(k + 1, len(time))))
    sides = [near[:SIDE] for near in (before, after) if len(near) >= SIDE]
    around = [
        np.concatenate([before[:left], after[:right]])
        for left, right in AROUND
        if len(before) >= left and len(after) >= right
    ]
    for near in (*sides, *around):
        weights = _parabola_weights(time[near] - time[k])
        predicted = np.median(weights @ position[near], axis=0)
        limit = LIMIT * sigma * (1 + 0.6 * float(np.median(np.linalg.norm(weights, axis=1)))) + 0.002
        if np.abs(position[k] - predicted).max() <= limit:
            return False
    return len(sides) == 2 or (len(sides) == 1 and _is_smooth(time[sides[0]], position[sides[0]], sigma))


def _is_smooth(time: np.ndarray, position: np.ndarray, sigma: float) -> bool:
    design = np.vander(time - time[0], 3)
    left = position - design @ np.linalg.lstsq(design, position, rcond=None)[0]
    return bool(np.abs(left).max() < SMOOTH * sigma)


def _parabola_weights(t: np.ndarray) -> np.ndarray:
    """(triples, n) weights of n samples at times t (n,): the parabola through each triple, evaluated at time 0."""
    triples = _triples(len(t))
    rows, at = np.arange(len(triples)), t[triples]
    out = np.zeros((len(triples), len(t)))
    for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        out[rows, triples[:, i]] = at[:, j] / (at[:, j] - at[:, i]) * (at[:, k] / (at[:, k] - at[:, i]))
    return out


@lru_cache(maxsize=2 * SIDE)
def _triples(count: int) -> np.ndarray:
    """(triples, 3) indices of all triples of so many samples."""
    return np.array(list(itertools.combinations(range(count), 3)))
