"""What more samples and more simulations buy."""

from __future__ import annotations

from collections.abc import Sequence

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


def mean_curve(curves: Sequence[tuple[Sequence[int], Sequence[float]]], points: int = 24) -> list[tuple[int, float]]:
    """The mean over clips of the best so far, at so many budgets from where every clip has one to the largest spent.

    curves: of each clip the rising numbers of simulations at which its best was noted, and that best.
    """
    curves = [(s, r) for s, r in curves if len(s)]
    if not curves:
        return []
    budgets = np.unique(np.linspace(max(s[0] for s, _ in curves), max(s[-1] for s, _ in curves), points).astype(int))
    at = [np.asarray(r)[np.searchsorted(s, budgets, "right") - 1] for s, r in curves]
    return [(int(b), float(v)) for b, v in zip(budgets, np.mean(at, axis=0), strict=True)]
