"""What more samples buy: the expected score of the best of k."""

from __future__ import annotations

import numpy as np


def best_of_curve(reward: np.ndarray, score: np.ndarray) -> np.ndarray:
    """(K,) expected `score` (K,) of the one with the best `reward` (K,) of k drawn without replacement, k = 1 … K.

    The r-th best of K is the best of k with probability C(K - r - 1, k - 1) / C(K, k), r from 0.
    """
    count = len(reward)
    ordered = score[np.argsort(-reward, kind="stable")]
    out = np.empty(count)
    for k in range(1, count + 1):
        weight = np.zeros(count)
        weight[0] = k / count
        for r in range(1, count - k + 1):
            weight[r] = weight[r - 1] * (count - r - k + 1) / (count - r)
        out[k - 1] = weight @ ordered
    return out
