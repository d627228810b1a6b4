"""Velocity jumps in a track: impacts, and hits by something that is not in the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

WINDOWS = (7, 4)  # samples on each side of a candidate jump; the shorter one where other jumps are near
LEAST_SIDE = 3
Z_JUMP = 6.5  # least size of a jump, in standard errors
Z_EXPECTED = 4.5  # the same where a jump is expected
OFFSETS = np.linspace(-0.5, 0.5, 21)  # candidate times of a jump between two samples, in sample intervals
EXPLAINED = (
    9.0  # largest mean square residual of three coordinates, in units of their noise, that is noise: 3 usual ones
)
GAIN_OVER_CUBIC = 20.0  # by how much chi squared of a parabola with a jump must be below that of a cubic


@dataclass(frozen=True)
class VelocityJump:
    """A sudden change of velocity.

    Attributes:
        time: s.
        position: (3,) m, of the body at that time.
        change: (3,) m/s, velocity after minus velocity before.
        z: |change| in standard errors.
        misfit: Mean square residual, m², of a parabola with the jump over the samples around it.
    """

    time: float
    position: np.ndarray
    change: np.ndarray
    z: float
    misfit: float = 0.0


def find_velocity_jumps(
    time: np.ndarray,
    position: np.ndarray,
    sigma: float,
    expected: Callable[[VelocityJump], bool] = lambda _: False,
    *,
    apart: float = 0.0,
) -> list[VelocityJump]:
    """The velocity jumps of a track without outliers, in the order of time.

    Args:
        time: (T,) s.
        position: (T, 3) m.
        sigma: Standard deviation of a coordinate, m.
        expected: Whether a jump is a likely one (a bounce on the ground), for which `Z_EXPECTED` is enough.
        apart: Time within which no second jump is sought, s.
    """
    found: list[tuple[int, VelocityJump]] = []
    more = round(apart / float(np.median(np.diff(time)))) if apart else 0
    waiting = [_Piece(time, position, sigma, start=0, stop=len(time), more=more)]
    while waiting:
        piece = waiting.pop()
        candidates = range(piece.start + LEAST_SIDE, piece.stop - LEAST_SIDE + 1)
        jumps = [(c, k) for k in candidates if (c := _jump_between(piece, k)) is not None]
        jumps = [(c, k) for c, k in jumps if c.z >= Z_JUMP or (c.z >= Z_EXPECTED and expected(c))]
        # into the window of a false jump another one reaches: those that explain theirs come first, and bounces
        jumps.sort(key=lambda pair: (pair[0].misfit > EXPLAINED * sigma**2, not expected(pair[0]), -pair[0].z))
        chosen = next((k for _, k in jumps if not _caused_by_one_sample(piece, k)), None)
        if chosen is None:
            continue
        best = min((c for c, k in jumps if abs(k - chosen) <= 1), key=lambda c: c.misfit)
        before, split, after = (int(np.searchsorted(time, best.time + d)) for d in (-apart, 0.0, apart))
        found.append((split, best))
        waiting += [replace(piece, stop=max(before, piece.start)), replace(piece, start=min(after, piece.stop))]
    return [b for _, b in sorted(found, key=lambda pair: pair[1].time)]


@dataclass(frozen=True)
class _Piece:
    """The samples `start` to `stop` - 1 of a track: time (T,) s, position (T, 3) m, sigma m.

    more: samples by which windows are longer, since a filter rounds jumps off.
    """

    time: np.ndarray
    position: np.ndarray
    sigma: float
    start: int
    stop: int
    more: int = 0

    def without(self, i: int) -> _Piece:
        """The piece without one sample."""
        time, position = np.delete(self.time, i), np.delete(self.position, i, axis=0)
        return replace(self, time=time, position=position, stop=self.stop - 1)


def _caused_by_one_sample(piece: _Piece, k: int) -> bool:
    """Whether a jump disappears when one sample is removed, which then is an undetected outlier."""
    for i in range(max(piece.start, k - WINDOWS[0] - piece.more), min(piece.stop, k + WINDOWS[0] + piece.more)):
        left = _jump_between(piece.without(i), k - (i < k), 0.5 * GAIN_OVER_CUBIC)
        if left is None or left.z < 0.5 * Z_JUMP:
            return True
    return False


def _jump_between(piece: _Piece, k: int, gain: float = GAIN_OVER_CUBIC) -> VelocityJump | None:
    """A jump between samples k - 1 and k, if it explains the samples around them better than a cubic does."""
    sizes = (w + piece.more for w in WINDOWS)
    windows = (replace(piece, start=max(piece.start, k - w), stop=min(piece.stop, k + w)) for w in sizes)
    found = (_jump_in(window, k, gain) for window in windows)
    return next((jump for jump in found if jump is not None), None)


def _jump_in(window: _Piece, k: int, gain: float) -> VelocityJump | None:
    """The same from the samples of a window alone."""
    time, sigma, inside = window.time, window.sigma, slice(window.start, window.stop)
    middle = (time[k - 1] + time[k]) / 2
    t, x = time[inside] - middle, window.position[inside]
    scale = max(t[-1], -t[0])
    powers = (t / scale)[:, None] ** np.arange(4)
    smooth = _rss(powers, x)
    step = time[k] - time[k - 1]
    screened = _Hinges(powers, t, x, np.array([-0.4, 0.0, 0.4]) * step)
    if smooth - screened.rss.min() < gain * sigma**2:
        return None
    tried = _Hinges(powers, t, x, OFFSETS * step)
    best = int(tried.rss.argmin())
    at, beta = tried.at[best], tried.beta[best]
    z = float(np.linalg.norm(beta[3])) / (sigma * np.sqrt(max(tried.variance[best], 1e-30)))
    here = np.array([1.0, at / scale, (at / scale) ** 2]) @ beta[:3]
    return VelocityJump(middle + at, here, beta[3], z, float(tried.rss[best]) / len(t))


class _Hinges:
    """Least-squares parabolas with a jump of slope at the times `at` (P,).

    rss (P,): residual sum of squares. beta (P, 4, 3): coefficients, the last one the jump. variance (P,): of the jump,
    for noise of unit variance.
    """

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
