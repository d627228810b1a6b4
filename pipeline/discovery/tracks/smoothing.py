"""Whether positions were smoothed before they were written down, and how much noise there was before.

White noise has fourth differences of the same size at every lag, while those of smooth motion grow with the fourth
power of the lag. Those of filtered noise are small at lags below the filter's width, and level off above it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.tracks.noise import leave_one_out

LAGS = np.arange(1, 7)  # samples
LEAST_VALUES = 300  # fourth differences at a lag: fewer may look filtered by chance
LEAST_KNOWN = 40  # the same of tracks that are known to be filtered
LEAST_LAGS = 4  # these tell the width: at larger lags impacts matter more
WIDTHS = np.geomspace(0.5, 6.0, 26)  # samples
LARGEST_RATIO = 0.6  # of the first to the third lag's, of noise that may have been filtered
BETTER = 0.5  # largest misfit of filtered noise over that of white noise with smooth motion
QUANTILE, NORMAL_QUANTILE = 0.1, 0.1257  # of |x|: impacts and outliers enlarge the upper part only
RANGE = 3.0  # widths within which a sample feels an impact or the end of the recording
DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


@dataclass(frozen=True)
class Smoothing:
    """A filter that positions went through.

    Attributes:
        width: Standard deviation of the equal Gaussian filter, samples; 0 where there was none.
        interval: Between two samples, s.
    """

    width: float = 0.0
    interval: float = 0.0

    @property
    def information(self) -> float:
        """Independent samples per sample; also the share of the noise's variance that the filter leaves."""
        return min(1.0, 1 / (2 * np.sqrt(np.pi) * self.width)) if self.width else 1.0

    @property
    def blur(self) -> float:
        """Standard deviation of the filter, s."""
        return self.width * self.interval

    @property
    def reach(self) -> float:
        """Time within which a sample feels an impact or the end of the recording, s."""
        return RANGE * self.blur


UNFILTERED = Smoothing()


@dataclass(frozen=True)
class TrackNoise:
    """The noise of tracks as it was before any smoothing.

    A filter does not make the fit of a smooth curve more precise, so the noise before it is what counts.

    Attributes:
        sigma: Rough standard deviation of a coordinate, m.
        smoothing: The filter.
    """

    sigma: float
    smoothing: Smoothing


def find_smoothing(
    times: Sequence[np.ndarray], positions: Sequence[np.ndarray], least: int = LEAST_VALUES
) -> TrackNoise | None:
    """The filter of some tracks, and the noise before it; None where there was no filter.

    times: (T,) s of each track; positions: (T, 3) m; least: fourth differences at the largest lag in use.
    """
    sizes = []
    for lag in LAGS:
        each = [leave_one_out(t, x, int(lag)) for t, x in zip(times, positions, strict=True)]
        found = np.abs(np.concatenate([r.ravel() for r in each]))
        found = found[np.isfinite(found) & (found > 1e-12)]
        if len(found) < least:
            break
        sizes.append(np.quantile(found, QUANTILE) / NORMAL_QUANTILE)
    if len(sizes) < LEAST_LAGS or sizes[0] > LARGEST_RATIO * sizes[2]:
        return None
    logs, lags = np.log(sizes), LAGS[: len(sizes)]
    shapes = np.log(np.stack([_size_at(lags, width) for width in WIDTHS]))
    white = 0.5 * np.log(1 + np.geomspace(1e-12, 1e12, 97)[:, None] * lags.astype(float) ** 8)
    if _misfit(logs - shapes)[0].min() > BETTER * _misfit(logs - white)[0].min():
        return None
    misfit, left = _misfit((logs - shapes)[:, :LEAST_LAGS])
    best = int(misfit.argmin())
    smoothing = Smoothing(float(WIDTHS[best]), float(np.median(np.concatenate([np.diff(t) for t in times]))))
    return TrackNoise(float(np.exp(left[best])) / smoothing.information**0.5, smoothing)


def _misfit(off: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean square of deviations (..., L) at the first L lags from their weighted mean, and that mean."""
    weights = 1.0 / LAGS[: off.shape[-1]]
    weights = weights / weights.sum()
    mean = (weights * off).sum(-1)
    return (weights * (off - mean[..., None]) ** 2).sum(-1), mean


def _size_at(lags: np.ndarray, width: float) -> np.ndarray:
    """Standard deviation of the fourth differences at some lags (L,) of unit noise from a Gaussian filter, over that of
    white noise."""
    apart = lags[:, None, None] * np.abs(np.subtract.outer(np.arange(5), np.arange(5)))
    variance = np.einsum("i,lij,j->l", DIFFERENCE, np.exp(-(apart**2) / (4 * width**2)), DIFFERENCE)
    return np.sqrt(np.maximum(variance, 1e-12) / (DIFFERENCE**2).sum())
