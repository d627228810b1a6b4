"""Where a track's velocity jumps: impacts, and blows that nobody sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WINDOW = 7  # samples on each side of a suspected jump
LEAST_SIDE = 3
Z_BREAK = 6.5  # standard errors that a jump of velocity must have
GAIN_OVER_CUBIC = 20.0  # how much better (chi squared) a jump must explain the window than a smooth cubic does


@dataclass(frozen=True)
class Break:
    """A jump of velocity. time, s; position (3,) m, of the track then; jump (3,) m/s; z: |jump| in standard errors."""

    time: float
    position: np.ndarray
    jump: np.ndarray
    z: float


def find_breaks(time: np.ndarray, position: np.ndarray, sigma: float) -> list[Break]:
    """The jumps of a track without outliers: time (T,), position (T, 3), sigma m. In the order of time."""
    found: list[tuple[int, Break]] = []
    waiting = [(0, len(time))]
    while waiting:
        start, stop = waiting.pop()
        places = range(start + LEAST_SIDE, stop - LEAST_SIDE + 1)
        jumps = [(c, k) for k in places if (c := _jump_between(time, position, sigma, k, start, stop)) is not None]
        jumps = [(c, k) for c, k in jumps if c.z >= Z_BREAK]
        jumps.sort(key=lambda pair: -pair[0].z)
        best = next((c for c, k in jumps if not _of_one_sample(time, position, sigma, k, start, stop)), None)
        if best is None:
            continue
        split = int(np.searchsorted(time, best.time))
        found.append((split, best))
        waiting += [(start, split), (split, stop)]
    return [b for _, b in sorted(found, key=lambda pair: pair[1].time)]


def _of_one_sample(time: np.ndarray, position: np.ndarray, sigma: float, k: int, start: int, stop: int) -> bool:
    """Whether a jump is gone without some single sample: an outlier that was not told from the path."""
    for i in range(max(start, k - WINDOW), min(stop, k + WINDOW)):
        t, x = np.delete(time, i), np.delete(position, i, axis=0)
        left = _jump_between(t, x, sigma, k - (i < k), start, stop - 1, 0.5 * GAIN_OVER_CUBIC)
        if left is None or left.z < 0.5 * Z_BREAK:
            return True
    return False


def _jump_between(
    time: np.ndarray, position: np.ndarray, sigma: float, k: int, start: int, stop: int, gain: float = GAIN_OVER_CUBIC
) -> Break | None:
    """A jump between samples k - 1 and k, where it explains the samples around them better than a cubic does."""
    first, last = max(start, k - WINDOW), min(stop, k + WINDOW)
    middle = (time[k - 1] + time[k]) / 2
    t, x = time[first:last] - middle, position[first:last]
    scale = max(t[-1], -t[0])
    powers = (t / scale)[:, None] ** np.arange(4)
    smooth = _rss(powers, x)
    best: tuple[float, float, np.ndarray, float] | None = None
    for place in (-0.4, 0.0, 0.4):
        at = place * (time[k] - time[k - 1])
        hinge = np.column_stack([powers[:, :3], np.maximum(0, t - at)])
        gram = np.linalg.pinv(hinge.T @ hinge)
        beta = gram @ (hinge.T @ x)
        rss = float(((x - hinge @ beta) ** 2).sum())
        if best is None or rss < best[0]:
            best = (rss, at, beta, float(gram[3, 3]))
    assert best is not None
    rss, at, beta, variance = best
    if smooth - rss < gain * sigma**2:
        return None
    z = float(np.linalg.norm(beta[3])) / (sigma * np.sqrt(max(variance, 1e-30)))
    place = np.array([1.0, at / scale, (at / scale) ** 2]) @ beta[:3]
    return Break(middle + at, place, beta[3], z)


def _rss(design: np.ndarray, x: np.ndarray) -> float:
    beta, *_ = np.linalg.lstsq(design, x, rcond=None)
    return float(((x - design @ beta) ** 2).sum())
