"""Means with bootstrap intervals, and shares with Wilson's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest


@dataclass(frozen=True)
class Estimate:
    """A mean over n clips with its 95 % interval (percentile bootstrap); NaN where n is 0."""

    mean: float
    low: float
    high: float
    n: int

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Estimate:
        """From a row's mean, low, high and clips, which may be text."""
        return cls(float(row["mean"]), float(row["low"]), float(row["high"]), int(row["clips"]))

    def row(self) -> dict[str, float]:
        return {"mean": self.mean, "low": self.low, "high": self.high, "clips": self.n}


def bootstrap_mean(values: np.ndarray, resamples: int, rng: np.random.Generator) -> Estimate:
    """The mean of `values` (n,), NaN left out, and its interval from `resamples` resamples."""
    kept = values[~np.isnan(values)]
    if not len(kept):
        return Estimate(np.nan, np.nan, np.nan, 0)
    means = rng.choice(kept, (resamples, len(kept))).mean(1)
    low, high = np.percentile(means, [2.5, 97.5])
    return Estimate(float(kept.mean()), float(low), float(high), len(kept))


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share, hits of count."""
    if count == 0:
        return 0.0, 1.0
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)
