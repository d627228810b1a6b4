"""Confidence intervals: of means and of pooled ratios by the bootstrap, of shares by Wilson's score interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

CONFIDENCE = 0.95
BATCH_NUMBERS = 2**20  # that are drawn at a time, so that memory does not grow with the clips


@dataclass(frozen=True)
class MeanInterval:
    """A mean over clips, or a ratio of sums over clips, with its 95 % interval (percentile bootstrap).

    Attributes:
        mean: The mean or the ratio; NaN where n is 0, and so are the limits.
        low: Lower limit.
        high: Upper limit.
        n: Number of clips.
    """

    mean: float
    low: float
    high: float
    n: int

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> MeanInterval:
        """From the columns mean, low, high and clips of a table, as numbers or text."""
        return cls(float(row["mean"]), float(row["low"]), float(row["high"]), int(row["clips"]))

    def row(self) -> dict[str, float]:
        """The columns from which `of_row` reads."""
        return {"mean": self.mean, "low": self.low, "high": self.high, "clips": self.n}


NO_CLIPS = MeanInterval(np.nan, np.nan, np.nan, 0)


def bootstrap_mean(values: np.ndarray, resamples: int, seed: int = 0) -> MeanInterval:
    """The mean of some values with its percentile-bootstrap interval.

    Args:
        values: (n,); NaN is left out.
        resamples: Number of resamples.
        seed: Of the resamples. They are drawn anew in each call, so that an interval does not depend on what else a
            table has.
    """
    kept = values[~np.isnan(values)]
    if not len(kept):
        return NO_CLIPS
    mean = float(kept.mean())
    if len(kept) == 1:  # scipy asks for two
        return MeanInterval(mean, mean, mean, 1)
    from scipy import stats  # takes a second, and this module is imported where no interval is needed

    interval = stats.bootstrap(
        (kept,),
        np.mean,
        n_resamples=resamples,
        batch=max(1, BATCH_NUMBERS // len(kept)),
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return MeanInterval(mean, float(interval.low), float(interval.high), len(kept))


def bootstrap_ratio(part: np.ndarray, whole: np.ndarray, resamples: int, seed: int = 0) -> MeanInterval:
    """The ratio of two sums over clips, with its percentile-bootstrap interval; clips are resampled, with both numbers.

    Args:
        part: (n,) of each clip; a clip with NaN is left out.
        whole: (n,) of each clip, 0 or more; a clip with NaN is left out.
        resamples: Number of resamples. Those in which the whole is 0 have no ratio and are left out.
        seed: Of the resamples, as in `bootstrap_mean`.

    Returns:
        `NO_CLIPS` where the sum of `whole` is 0.
    """
    kept = ~(np.isnan(part) | np.isnan(whole))
    part, whole = part[kept], whole[kept]
    if not whole.any():
        return NO_CLIPS
    ratio = float(part.sum() / whole.sum())
    drawn = _drawn_ratios(((part, whole),), resamples, seed)[0]
    low, high = _limits(drawn, ratio)
    return MeanInterval(ratio, low, high, len(part))


def bootstrap_ratio_difference(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], resamples: int, seed: int = 0
) -> MeanInterval:
    """The first ratio of two sums over clips minus the second, as `bootstrap_ratio`, of the same resampled clips.

    Args:
        first: (n,) parts and (n,) wholes; a clip that has NaN in either ratio is left out.
        second: Likewise, of the same clips.
        resamples: Number of resamples.
        seed: Of the resamples.
    """
    kept = ~np.isnan([*first, *second]).any(0)
    pairs = [(part[kept], whole[kept]) for part, whole in (first, second)]
    if not all(whole.any() for _, whole in pairs):
        return NO_CLIPS
    a, b = (float(part.sum() / whole.sum()) for part, whole in pairs)
    drawn = _drawn_ratios(pairs, resamples, seed)
    low, high = _limits(drawn[0] - drawn[1], a - b)
    return MeanInterval(a - b, low, high, int(kept.sum()))


def _drawn_ratios(pairs: Sequence[tuple[np.ndarray, np.ndarray]], resamples: int, seed: int) -> np.ndarray:
    """(P, R) ratios of the sums of parts and wholes (n,) over resampled clips; NaN where the whole is 0."""
    rng, clips = np.random.default_rng(seed), len(pairs[0][0])
    batch = max(1, BATCH_NUMBERS // clips)
    found = []
    for start in range(0, resamples, batch):
        drawn = rng.integers(clips, size=(min(batch, resamples - start), clips))
        sums = [(part[drawn].sum(1), whole[drawn].sum(1)) for part, whole in pairs]
        found.append([np.divide(p, w, out=np.full(len(w), np.nan), where=w > 0) for p, w in sums])
    return np.concatenate(found, 1)


def _limits(drawn: np.ndarray, otherwise: float) -> tuple[float, float]:
    """The percentile interval of the numbers that are not NaN."""
    tail = (1 - CONFIDENCE) / 2
    numbers = drawn[~np.isnan(drawn)]
    low, high = np.quantile(numbers, [tail, 1 - tail]) if len(numbers) else (otherwise, otherwise)
    return float(low), float(high)


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of the share hits / count; 0 to 1 where count is 0."""
    if count == 0:
        return 0.0, 1.0
    from scipy import stats

    interval = stats.binomtest(hits, count).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)
