"""Where a track's velocity jumps: impacts, and blows that nobody sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

WINDOWS = (7, 4)  # samples on each side of a suspected jump; the shorter where others are near
LEAST_SIDE = 3
Z_BREAK = 6.5  # standard errors that a jump of velocity must have
Z_EXPECTED = 4.5  # the same where one is expected
PLACES = np.linspace(-0.5, 0.5, 21)  # of a jump between two samples: a fast body goes far between them
GAIN_OVER_CUBIC = 20.0  # how much better (chi squared) a jump must explain the window than a smooth cubic does


@dataclass(frozen=True)
class Break:
    """A jump of velocity. time, s; position (3,) m, of the track then; jump (3,) m/s; z: |jump| in standard errors;
    misfit: mean square, m², that a parabola with the jump leaves of the samples around it."""

    time: float
    position: np.ndarray
    jump: np.ndarray
    z: float
    misfit: float = 0.0


def find_breaks(
    time: np.ndarray, position: np.ndarray, sigma: float, expected: Callable[[Break], bool] = lambda _: False
) -> list[Break]:
    """The jumps of a track without outliers: time (T,), position (T, 3), sigma m. In the order of time.

    expected: whether a jump is where and as one should be (a bounce on the ground), so that less of it will do.
    """
    found: list[tuple[int, Break]] = []
    waiting = [(0, len(time))]
    while waiting:
        start, stop = waiting.pop()
        places = range(start + LEAST_SIDE, stop - LEAST_SIDE + 1)
        jumps = [(c, k) for k in places if (c := _jump_between(time, position, sigma, k, start, stop)) is not None]
        jumps = [(c, k) for c, k in jumps if c.z >= Z_BREAK or (c.z >= Z_EXPECTED and expected(c))]
        jumps.sort(key=lambda pair: -pair[0].z)
        chosen = next((k for _, k in jumps if not _of_one_sample(time, position, sigma, k, start, stop)), None)
        if chosen is None:
            continue
        best = min((c for c, k in jumps if abs(k - chosen) <= 1), key=lambda c: c.misfit)
        split = int(np.searchsorted(time, best.time))
        found.append((split, best))
        waiting += [(start, split), (split, stop)]
    return [b for _, b in sorted(found, key=lambda pair: pair[1].time)]


def _of_one_sample(time: np.ndarray, position: np.ndarray, sigma: float, k: int, start: int, stop: int) -> bool:
    """Whether a jump is gone without some single sample: an outlier that was not told from the path."""
    for i in range(max(start, k - WINDOWS[0]), min(stop, k + WINDOWS[0])):
        t, x = np.delete(time, i), np.delete(position, i, axis=0)
        left = _jump_between(t, x, sigma, k - (i < k), start, stop - 1, 0.5 * GAIN_OVER_CUBIC)
        if left is None or left.z < 0.5 * Z_BREAK:
            return True
    return False


def _jump_between(
    time: np.ndarray, position: np.ndarray, sigma: float, k: int, start: int, stop: int, gain: float = GAIN_OVER_CUBIC
) -> Break | None:
    """A jump between samples k - 1 and k, where it explains the samples around them better than a cubic does."""
    found = (_jump_in(time, position, sigma, k, max(start, k - w), min(stop, k + w), gain) for w in WINDOWS)
    return next((jump for jump in found if jump is not None), None)


def _jump_in(
    time: np.ndarray, position: np.ndarray, sigma: float, k: int, first: int, last: int, gain: float
) -> Break | None:
    """The same of samples first to last - 1 alone."""
    middle = (time[k - 1] + time[k]) / 2
    t, x = time[first:last] - middle, position[first:last]
    scale = max(t[-1], -t[0])
    powers = (t / scale)[:, None] ** np.arange(4)
    smooth = _rss(powers, x)
    step = time[k] - time[k - 1]
    screened = _Hinges(powers, t, x, np.array([-0.4, 0.0, 0.4]) * step)
    if smooth - screened.rss.min() < gain * sigma**2:
        return None
    tried = _Hinges(powers, t, x, PLACES * step)
    best = int(tried.rss.argmin())
    at, beta = tried.at[best], tried.beta[best]
    z = float(np.linalg.norm(beta[3])) / (sigma * np.sqrt(max(tried.variance[best], 1e-30)))
    place = np.array([1.0, at / scale, (at / scale) ** 2]) @ beta[:3]
    return Break(middle + at, place, beta[3], z, float(tried.rss[best]) / len(t))


class _Hinges:
    """Parabolas whose slopes jump at the times `at` (P,): what they leave, rss (P,); coefficients beta (P, 4, 3), of
    which the last is the jump; and its variance (P,) for noise of one."""

    def __init__(self, powers: np.ndarray, t: np.ndarray, x: np.ndarray, at: np.ndarray) -> None:
        design = np.empty((len(at), len(t), 4))
        design[..., :3], design[..., 3] = powers[:, :3], np.maximum(0, t - at[:, None])
        across = design.transpose(0, 2, 1)
        inverse = np.linalg.pinv(across @ design)
        self.at, self.beta, self.variance = at, inverse @ (across @ x), inverse[:, 3, 3]
        self.rss = ((x - design @ self.beta) ** 2).sum((1, 2))


def _rss(design: np.ndarray, x: np.ndarray) -> float:
    beta, *_ = np.linalg.lstsq(design, x, rcond=None)
    return float(((x - design @ beta) ** 2).sum())
