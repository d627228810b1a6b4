"""Arcs: the stretches of a track in which the acceleration in the picture is constant, cut where it jumps.

The cuts minimise the squared residuals of a line or a quadratic for each stretch plus a price for each coefficient.
They are found by dynamic programming (Jackson et al., "An algorithm for optimal partitioning of data on an interval",
2005). Residuals are capped, so that single bad outlines do not cut a track.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.compiled import kernel

CONTACT_SAMPLES = 5  # of an arc that may be an impact
CONTACT_PULL = 5.0  # its acceleration over that of the arcs beside it
CONTACT_TURN = 0.5  # of the speed, by which the velocity changes in it
LEAST_SAMPLES = 3  # of an arc without acceleration; one more with it
PRICE = 2.0  # of an arc: so many times what the Bayesian information criterion charges for its parameters
CAP = 4.0  # standard deviations: an outlier's residual costs no more
DEGREES = (1, 2)  # of an arc's polynomial in time: without and with acceleration
ROUNDS = 3  # in which outliers are found and left out
LEAST_SIGMA = 0.1  # px, of a centre
SYSTEMATIC = 0.01  # radii: errors of outlines that are alike from frame to frame (shading, shadows, blur)


@dataclass(frozen=True)
class Arc:
    """A stretch of constant acceleration.

    Attributes:
        body: The track's.
        start: Index of its first sample in the track.
        stop: Index after its last.
        time: s, its middle, at which position and velocity are given.
        span: s, from its first sample to its last.
        position: (2,) px.
        velocity: (2,) px/s.
        acceleration: (2,) px/s²; 0 where a straight line at constant speed explains the arc as well.
        covariance: (3, 3) of (position, velocity, acceleration), the same for both coordinates; that of a quadratic.
        rms: px, of its residuals.
        bend: (2,) px/s², the acceleration of a quadratic, whether a line explains the arc as well or not.
    """

    body: int
    start: int
    stop: int
    time: float
    span: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    covariance: np.ndarray
    rms: float
    bend: np.ndarray

    @property
    def acceleration_sigma(self) -> float:
        """px/s², of each coordinate."""
        return float(np.sqrt(self.covariance[2, 2]))

    def velocity_at(self, time: float) -> np.ndarray:
        """(2,) px/s at a time, s."""
        return self.velocity + (time - self.time) * self.acceleration

    def position_at(self, times: np.ndarray) -> np.ndarray:
        """(T, 2) px at times (T,) s."""
        t = (np.asarray(times, float) - self.time)[:, None]
        return self.position + t * self.velocity + 0.5 * t**2 * self.acceleration


def design(times: np.ndarray) -> np.ndarray:
    """(T, 3): a position at times (T,) s from position, velocity and acceleration at time 0."""
    return np.stack([np.ones_like(times), times, 0.5 * times**2], 1)


def cut_arcs(track: ImageTrack) -> list[Arc]:
    """The arcs of a track, in order. A track of fewer than `LEAST_SAMPLES` whole outlines has none."""
    use = np.flatnonzero(track.whole)
    if len(use) < LEAST_SAMPLES:
        return []
    sigma = float(np.sqrt(track.sigma**2 + LEAST_SIGMA**2 + (SYSTEMATIC * track.radius) ** 2))
    good = np.ones(len(use), bool)
    for _ in range(ROUNDS):
        index = use[good]
        if len(index) < LEAST_SAMPLES:
            return []
        parts = _partition(track.times[index], track.centre[index], sigma)
        arcs = [_fit(track, index[a:b], degree, sigma) for a, b, degree in parts]
        residual = np.full(len(use), np.inf)
        for arc in arcs:
            near = np.abs(track.centre[use] - arc.position_at(track.times[use])).max(1)
            inside = (use >= arc.start) & (use < arc.stop)
            residual[inside] = near[inside]
        spread = max(sigma, float(np.median([a.rms for a in arcs])))
        kept = residual < CAP * spread
        if (kept == good).all():
            break
        good = kept
    inner = [b for a, b, c in zip(arcs, arcs[1:], arcs[2:], strict=False) if not _is_contact(a, b, c)]
    return [*arcs[:1], *inner, *arcs[-1:]] if len(arcs) > 1 else arcs


def _is_contact(before: Arc, arc: Arc, after: Arc) -> bool:
    """Whether an arc is an impact that a few frames show: as an arc it would hide the jump of the velocity."""
    first, own, last = (float(np.linalg.norm(a.acceleration)) for a in (before, arc, after))
    ends = before.velocity_at(before.time + before.span / 2), after.velocity_at(after.time - after.span / 2)
    speed = max(float(np.linalg.norm(v)) for v in ends)
    short = arc.stop - arc.start <= CONTACT_SAMPLES
    return short and own > CONTACT_PULL * max(first, last) and own * arc.span > CONTACT_TURN * speed


def _partition(times: np.ndarray, centre: np.ndarray, sigma: float) -> list[tuple[int, int, int]]:
    """The best partition of samples at times (T,) with centres (T, 2): start, stop and degree of each part."""
    count = len(times)
    price = PRICE * np.log(max(2 * count, 2))
    before = np.zeros((count + 1, 2), np.int64)
    scaled = (times - times[0]) / max(times[-1] - times[0], 1e-9)
    _best_parts(scaled, (centre - centre[0]) / sigma, price, before)
    parts = [(int(before[count, 0]), count, int(before[count, 1]))]
    while parts[-1][0]:
        stop = parts[-1][0]
        parts.append((int(before[stop, 0]), stop, int(before[stop, 1])))
    return parts[::-1]


@kernel
def _best_parts(times: np.ndarray, centre: np.ndarray, price: float, before: np.ndarray) -> None:
    """Write start and degree of the last part of the best partition of the first n samples into before[n].

    The start of a part moves back sample by sample, so that the sums that its polynomials follow from grow by one term.
    times: (T,); centre: (T, 2), in standard errors; before: (T + 1, 2).
    """
    count = len(times)
    best = np.full(count + 1, np.inf)
    best[0] = 0.0
    for stop in range(LEAST_SAMPLES, count + 1):
        n = m1 = m2 = m3 = m4 = 0.0  # sums of powers of the time before the last sample
        y, ty, tty = np.zeros(2), np.zeros(2), np.zeros(2)
        for start in range(stop - 1, -1, -1):
            t = times[start] - times[stop - 1]
            n, m1, m2, m3, m4 = n + 1, m1 + t, m2 + t**2, m3 + t**3, m4 + t**4
            y += centre[start]
            ty += t * centre[start]
            tty += t**2 * centre[start]
            if stop - start < LEAST_SAMPLES or not np.isfinite(best[start]):
                continue
            # Orthogonal polynomials: 1, u = t - mean, u² less its mean and its part along u.
            mean, square = m1 / n, m2 - m1 * m1 / n
            along = (m3 - m1 * m2 / n) / square
            level = (m2 - along * m1) / n
            bend = m4 - along * m3 - level * m2
            slope = (ty - mean * y) / square
            curve = (tty - along * ty - level * y) / max(bend, 1e-300)
            for degree in DEGREES:
                if stop - start < degree + 2:
                    continue
                total = best[start] + 2 * (degree + 1) * price
                for k in range(start, stop):
                    t = times[k] - times[stop - 1]
                    for axis in range(2):
                        off = centre[k, axis] - y[axis] / n - slope[axis] * (t - mean)
                        if degree == 2:
                            off -= curve[axis] * (t * t - along * t - level)
                        total += min(off * off, CAP**2)
                    if total > best[stop]:
                        break
                if total < best[stop]:
                    best[stop], before[stop, 0], before[stop, 1] = total, start, degree


def _fit(track: ImageTrack, index: np.ndarray, degree: int, sigma: float) -> Arc:
    times, centre = track.times[index], track.centre[index]
    middle = 0.5 * (times[0] + times[-1])
    matrix = design(times - middle)
    found = np.zeros((3, 2))
    found[: degree + 1] = np.linalg.lstsq(matrix[:, : degree + 1], centre, rcond=None)[0]
    residual = centre - matrix @ found
    rms = float(np.sqrt((residual**2).sum() / max(2 * (len(index) - degree - 1), 1)))
    covariance = np.linalg.pinv(matrix.T @ matrix) * max(rms, sigma) ** 2
    return Arc(
        body=track.body,
        start=int(index[0]),
        stop=int(index[-1]) + 1,
        time=middle,
        span=float(times[-1] - times[0]),
        position=found[0],
        velocity=found[1],
        acceleration=found[2],
        covariance=covariance,
        rms=rms,
        bend=np.linalg.lstsq(matrix, centre, rcond=None)[0][2],
    )
