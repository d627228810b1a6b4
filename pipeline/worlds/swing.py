"""A body that hangs from a point and swings in the plane of the picture: a damped pendulum, fitted to its track.

The point may be out of the picture. How long the pendulum is in px, the curvature of the path tells; how long it is in
metres, its period does, whatever the scale. The angle a obeys a'' = -w² sin a - 2 c a'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pipeline.bodies.tracks.image_track import MAD, ImageTrack
from pipeline.compiled import kernel
from pipeline.worlds.arcs import CAP, LEAST_SIGMA, PRICE, SYSTEMATIC, Arc

NUMBERS = 8  # of a swing: point, length, rate, angle, speed, damping, vertical
LEAST_SAMPLES = 8  # of a track: more numbers than it has are not fitted
RATES = 60  # tried for a start, from half a swing in the track to one in three samples
STEP = 1 / 240  # s, of the integration
LENGTHS = 1.0  # standard deviation of the logarithm of a pendulum's length over the extent of its path
DAMPINGS = 0.3  # of its damping over its angular frequency: most things that swing do so several times
RATE_BOUNDS = (-20.0, 20.0)  # of the logarithm of the rate, 1/s²: none is near


@dataclass(frozen=True)
class Swing:
    """A pendulum in the picture. Angles are from the downward vertical, towards the picture's right.

    Attributes:
        pivot: (2,) px, the point from which the body hangs.
        length: px, from there to the body's centre.
        rate: 1/s², w²: gravity over length, where the body is small.
        rate_error: Standard error of the rate, as a share.
        roll: rad, by which the vertical is turned in the picture, clockwise.
        angle: rad, at time 0.
        speed: rad/s, at time 0.
        damping: 1/s, c.
    """

    pivot: np.ndarray
    length: float
    rate: float
    rate_error: float
    roll: float
    angle: float
    speed: float
    damping: float

    def angles(self, times: np.ndarray) -> np.ndarray:
        """(T,) rad at increasing times (T,), s."""
        return _angles(np.asarray(times, float), self.rate, self.damping, self.angle, self.speed)

    def places(self, times: np.ndarray) -> np.ndarray:
        """(T, 2) px, the body's centre at increasing times (T,), s."""
        turned = self.angles(times) - self.roll
        return self.pivot + self.length * np.stack([np.sin(turned), np.cos(turned)], 1)


@kernel
def _angles(times: np.ndarray, rate: float, damping: float, angle: float, speed: float) -> np.ndarray:
    """The angles (T,) rad of a pendulum at increasing times (T,) s from a state at time 0, by Runge-Kutta steps."""
    out = np.empty(len(times))
    now, a, v = 0.0, angle, speed
    for k in range(len(times)):
        steps = max(int(np.ceil((times[k] - now) / STEP)), 1)
        h = (times[k] - now) / steps
        for _ in range(steps):
            f1 = -rate * np.sin(a) - 2 * damping * v
            v2 = v + h / 2 * f1
            f2 = -rate * np.sin(a + h / 2 * v) - 2 * damping * v2
            v3 = v + h / 2 * f2
            f3 = -rate * np.sin(a + h / 2 * v2) - 2 * damping * v3
            v4 = v + h * f3
            f4 = -rate * np.sin(a + h * v3) - 2 * damping * v4
            a += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (f1 + 2 * f2 + 2 * f3 + f4)
        now, out[k] = times[k], a
    return out


def fit_swing(track: ImageTrack, roll_deg: float, roll_error_deg: float) -> Swing | None:
    """The swing that fits a track best; None where no pendulum does, or less than half of a swing is seen.

    Less than that cannot be told from a slide: a body that speeds up along nearly a line.

    Args:
        track: Times from 0, s.
        roll_deg: By which the vertical is turned in the picture, clockwise.
        roll_error_deg: Its standard error.
    """
    use = track.whole
    if use.sum() < LEAST_SAMPLES:
        return None
    times, centre, known = track.times[use], track.centre[use], np.radians(roll_deg)
    sigma = floor(track)
    pivot, length = _circle(centre)
    length = max(length, 2 * sigma)  # of a body at rest
    start = _start(times, centre, pivot, length, known)

    def residuals(x: np.ndarray) -> np.ndarray:
        swing = _swing(x)
        off = (swing.places(times) - centre) / sigma
        return np.concatenate([off.ravel(), prior(track, swing), [(x[7] - known) / np.radians(roll_error_deg)]])

    scale = np.array([length / 20, length / 20, length / 20, 0.05, 0.05, 0.2, 0.05, 0.02])
    low, high = np.full(NUMBERS, -np.inf), np.full(NUMBERS, np.inf)
    low[2], low[6], (low[3], high[3]) = sigma, 0.0, RATE_BOUNDS
    found = least_squares(residuals, start, x_scale=scale, loss="soft_l1", bounds=(low, high))
    spread = max(float((found.fun[: 2 * len(times)] ** 2).mean()), 1.0)
    error = np.linalg.norm(np.linalg.pinv(found.jac * scale)[3]) * scale[3] * np.sqrt(spread)
    swing = _swing(found.x, float(error))
    return swing if np.sqrt(swing.rate) * np.ptp(times) > np.pi else None


def prior(track: ImageTrack, swing: Swing) -> np.ndarray:
    """(2,) how unusual the length and the damping of a track's swing are, in standard deviations."""
    extent = max(float(np.ptp(track.centre[track.whole], axis=0).max()), floor(track))
    return np.array([np.log(swing.length / extent) / LENGTHS, swing.damping / np.sqrt(swing.rate) / DAMPINGS])


def _swing(x: np.ndarray, rate_error: float = 0.0) -> Swing:
    """The swing of fitted numbers (NUMBERS,), of which the rate's is its logarithm."""
    return Swing(x[:2], float(x[2]), float(np.exp(x[3])), rate_error, float(x[7]), *map(float, x[4:7]))


def _circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and radius of the circle through points (T, 2), by linear least squares (Kåsa 1976)."""
    matrix = np.column_stack([2 * points, np.ones(len(points))])
    found = np.linalg.lstsq(matrix, (points**2).sum(1), rcond=None)[0]
    return found[:2], float(np.sqrt(max(found[2] + found[:2] @ found[:2], 0.0)))


def _start(times: np.ndarray, centre: np.ndarray, pivot: np.ndarray, length: float, roll: float) -> np.ndarray:
    """Numbers (NUMBERS,) from which the fit begins: the best harmonic motion of the angle about the circle's centre."""
    off = centre - pivot
    angle = np.unwrap(np.arctan2(off[:, 0], off[:, 1])) + roll
    best, out = np.inf, np.zeros(3)
    for w in np.geomspace(np.pi / np.ptp(times), 2 * np.pi / (3 * np.median(np.diff(times))), RATES):
        matrix = np.stack([np.cos(w * times), np.sin(w * times)], 1)
        parts = np.linalg.lstsq(matrix, angle, rcond=None)[0]
        misfit = float(((matrix @ parts - angle) ** 2).sum())
        if misfit < best:
            wide = min(float(np.hypot(*parts)), 0.9 * np.pi)
            best, out = misfit, np.array([2 * np.log(w * (1 + wide**2 / 16)), parts[0], w * parts[1]])
    return np.array([*pivot, length, *out, 0.1, roll])


def floor(track: ImageTrack) -> float:
    """px, the least error of a centre of a track: its masks', whatever its motion."""
    return float(np.hypot(LEAST_SIGMA, SYSTEMATIC * track.radius))


def arcs_evidence(track: ImageTrack, arcs: Sequence[Arc]) -> float:
    """Minus twice the log evidence of arcs of constant acceleration: the Bayesian information criterion."""
    use = np.flatnonzero(track.whole)
    off = np.full((len(use), 2), np.inf)
    for arc in arcs:
        own = (use >= arc.start) & (use < arc.stop)
        off[own] = arc.position_at(track.times[use[own]]) - track.centre[use[own]]
    return _evidence(track, off, sum(4 + 2 * bool(a.acceleration.any()) for a in arcs))


def swing_evidence(track: ImageTrack, swing: Swing) -> float:
    """The same of a swing."""
    use = track.whole
    unusual = float((prior(track, swing) ** 2).sum())
    return unusual + _evidence(track, swing.places(track.times[use]) - track.centre[use], NUMBERS)


def _evidence(track: ImageTrack, off: np.ndarray, numbers: int) -> float:
    """Of residuals (T, 2) px of a law with so many numbers, whose own error is the median residual.

    A residual beyond CAP errors is an outlier, and each number has the price that it has where arcs are cut.
    """
    error = max(MAD * float(np.median(np.abs(off))), floor(track))
    cost = np.minimum((off / error) ** 2, CAP**2).sum() + 2 * off.size * np.log(error)
    return float(cost + PRICE * numbers * np.log(off.size))
