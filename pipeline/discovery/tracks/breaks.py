"""Breaks of a recording between two samples: frames that were dropped, a camera that was bumped, names that swapped.

A body moves on smoothly where a recording breaks. So around each pair of neighbouring samples a cubic in time is fitted
to each body under several hypotheses: later samples came a few frames later than stated; later positions are shifted,
all bodies' alike; two bodies have each other's names later. They compete by BIC with those of physics: the motion is
smooth, or a body's velocity or force changes at some instant. No model of the motion is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.tracks.fault import Fault
from pipeline.discovery.tracks.noise import leave_one_out, rough_sigma
from pipeline.discovery.tracks.outliers import find_outliers
from pipeline.discovery.tracks.track import Track, frame_rate

BREAKS_PER_SAMPLE = 1e-4  # prior: how often a recording breaks, by each kind
PRICE = -2 * np.log(BREAKS_PER_SAMPLE)  # of a break, in units of chi squared
SHIFT_SIGMA = 0.1  # m, prior: by how much a bumped camera shifts positions
SIDES = (10, 6)  # samples on each side of a break; fewer where an impact is near
LEAST_SIDE = 4  # a cubic bends to fewer
MOST_FRAMES, MOST_NEARBY = 10, 3  # that are dropped at once, in one place and in each of two
FIT_SIGMAS = 4.0  # by which chi squared of a hypothesis that fits may exceed its mean
SAME_NOISE = 0.95  # ratio of the noise without breaks to that with them, above which it is the same
LEAP_SIGMAS = 4.0  # least difference of the step at a break from its neighbours; the evidence needs about twice that
SCREEN_SIGMAS = 3.0  # by which that of the recording as it is must exceed its mean, before faults are tried
RIDGE = 1e-12  # relative, of normal equations that may be singular
HINGES = 5  # instants in each interval at which a velocity may change
DEGREES = (3, 4, 5, 6)  # of the polynomials that a smooth motion may need


@dataclass(frozen=True)
class _Break:
    """A hypothesis about one interval of a recording.

    Attributes:
        faults: What it is: one fault, or two places at which frames were dropped.
        tracks: The recording without it.
        gain: BIC by which it is better than every hypothesis without a fault.
    """

    faults: tuple[Fault, ...]
    tracks: tuple[Track, ...]
    gain: float


def mend_breaks(tracks: Sequence[Track]) -> tuple[list[Track], list[Fault]]:
    """The tracks without the breaks of their recordings, and the breaks, in the order of clips and times.

    The noise seems larger than it is as long as there are breaks. Where it did, they are sought again.
    """
    before = _sigma(tracks)
    mended, faults = _with_noise(tracks, before)
    after = _sigma(mended)
    return _with_noise(tracks, after) if after < SAME_NOISE * before else (mended, faults)


def _with_noise(tracks: Sequence[Track], sigma: float) -> tuple[list[Track], list[Fault]]:
    """The same for a known standard deviation of a coordinate, m."""
    out, faults = list(tracks), []
    for clip in dict.fromkeys(t.clip for t in tracks):
        places = [i for i, t in enumerate(tracks) if t.clip == clip]
        mended, found = _mended(tuple(tracks[i] for i in places), sigma)
        for i, track in zip(places, mended, strict=True):
            out[i] = track
        faults += sorted(found, key=lambda f: f.time or 0.0)
    return out, faults


def _mended(tracks: tuple[Track, ...], sigma: float) -> tuple[tuple[Track, ...], list[Fault]]:
    """The tracks of one clip without its breaks, the clearest first, and the breaks."""
    faults: list[Fault] = []
    recorded = [t.time for t in tracks]
    for _ in range(max(map(len, recorded)) // LEAST_SIDE):
        found = max(_breaks(tracks, sigma), key=lambda b: b.gain, default=None)
        if found is None:
            break
        clock = np.unique([np.concatenate([t.time for t in tracks]), np.concatenate(recorded)], axis=1)
        faults += [replace(f, time=float(np.interp(f.time, *clock))) for f in found.faults]  # type: ignore[arg-type]
        tracks = found.tracks
        if any(f.fault == "swapped_names" for f in found.faults):  # samples of one are the other's now
            recorded = [np.interp(t.time, *clock) for t in tracks]
    return tracks, faults


def _sigma(tracks: Sequence[Track]) -> float:
    """Standard deviation of a coordinate, m: as stated, else from the positions."""
    stated = [t.sigma[np.isfinite(t.sigma)] for t in tracks if t.sigma is not None]
    if stated and sum(map(len, stated)):
        return float(np.median(np.concatenate(stated)))
    return rough_sigma(np.concatenate([leave_one_out(*_measured(t)) for t in tracks]))


def _measured(track: Track) -> tuple[np.ndarray, np.ndarray]:
    there = np.isfinite(track.position).all(1)
    return track.time[there], track.position[there]


def _without_outliers(time: np.ndarray, position: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    kept = ~find_outliers(time, position, sigma)
    return time[kept], position[kept]


def _breaks(tracks: tuple[Track, ...], sigma: float) -> Iterator[_Break]:
    """The breaks of a clip that win against all that is not a fault."""
    measured = [_without_outliers(*_measured(t), sigma) for t in tracks]
    times = np.unique(np.concatenate([t for t, _ in measured]))
    rate = frame_rate(tracks)
    middles = [m for m in (times[1:] + times[:-1]) / 2 if any(_leaps(*body, m, sigma) for body in measured)]
    for middle, side in itertools.product(middles, SIDES):
        around = _Around(measured, float(middle), side, sigma)
        if not around.bodies or around.fits(around.smooth, 0, SCREEN_SIGMAS):
            continue
        best = min(around.faults(rate, pairs=not around.goes_on), key=lambda h: h.bic)
        if around.fits(best.chi2, best.numbers) and best.bic < (ordinary := around.bic_without_fault):
            yield _Break(*_without(tracks, best, around.middle), ordinary - best.bic)


def _leaps(time: np.ndarray, position: np.ndarray, middle: float, sigma: float) -> bool:
    """Whether the step of a body about an instant is unlike those before and those after it."""
    k = int(np.searchsorted(time, middle))
    if min(k, len(time) - k) < LEAST_SIDE:
        return False
    steps = np.diff(position[k - LEAST_SIDE : k + LEAST_SIDE], axis=0)
    sides = steps[: LEAST_SIDE - 1].mean(0), steps[LEAST_SIDE:].mean(0)
    return min(float(np.linalg.norm(steps[LEAST_SIDE - 1] - side)) for side in sides) > LEAP_SIGMAS * sigma


@dataclass(frozen=True)
class _Hypothesis:
    """What may have happened: its chi squared, its numbers, and its BIC, with the prior of a fault.

    Attributes:
        dropped: (instant, frames) after which so many frames are missing.
        shift: (3,) m, by which later positions are off.
        swapped: Indices of two tracks.
    """

    chi2: float
    numbers: int
    bic: float
    dropped: tuple[tuple[float, int], ...] = ()
    shift: np.ndarray | None = None
    swapped: tuple[int, int] | None = None


class _Around:
    """The samples of a clip's bodies about one instant, at most `side` before and after it, and cubics through them.

    Attributes:
        middle: The instant, s.
        bodies: (index of the track, time (n,) since the instant, position (n, 3), after (n,) bool) of the bodies that
            have enough samples.
        smooth: Chi squared of the recording as it is.
    """

    def __init__(
        self, measured: Sequence[tuple[np.ndarray, np.ndarray]], middle: float, side: int, sigma: float
    ) -> None:
        self.middle, self.sigma, self.bodies = middle, sigma, []
        for i, (time, position) in enumerate(measured):
            k = int(np.searchsorted(time, middle))
            if min(k, len(time) - k) >= LEAST_SIDE:
                near = slice(max(k - side, 0), k + side)
                self.bodies.append((i, time[near] - middle, position[near], time[near] > middle))
        self.rows = sum(x.size for _, _, x, _ in self.bodies)
        self.smooth = float(sum(self._chi2(t, x) for _, t, x, _ in self.bodies))

    def _chi2(self, time: np.ndarray, position: np.ndarray, degree: int = 3) -> np.ndarray:
        """(...) chi squared of polynomials in times (..., n)."""
        return _rss(_powers(time, degree), position) / self.sigma**2

    def fits(self, chi2: float, numbers: int, sigmas: float = FIT_SIGMAS) -> bool:
        """Whether cubics with so many numbers more leave noise only."""
        freedom = max(self.rows - 12 * len(self.bodies) - numbers, 1)
        return chi2 < freedom + sigmas * np.sqrt(2 * freedom)

    def _bic(self, chi2: float, numbers: int) -> float:
        return chi2 + numbers * np.log(self.rows)

    @property
    def goes_on(self) -> bool:
        """Whether polynomials of the next degree leave noise only."""
        chi2 = sum(self._chi2(t, x, DEGREES[1]) for _, t, x, _ in self.bodies)
        return self.fits(float(chi2), 3 * len(self.bodies))

    @property
    def bic_without_fault(self) -> float:
        """The lowest BIC without a fault.

        A body moves smoothly, or at some instant its velocity changes, or its force, too; it never jumps.
        """
        total = 0.0
        for _, t, x, _ in self.bodies:
            hinges = np.concatenate([np.linspace(*pair, HINGES, endpoint=False) for pair in itertools.pairwise(t)])
            since = np.maximum(t - hinges[1:, None], 0)[..., None] / np.abs(t).max()
            parabola = np.broadcast_to(_powers(t, 2), (len(since), len(t), 3))
            found = [self._bic(float(self._chi2(t, x, d)), 3 * (d - 3)) for d in DEGREES]
            for powers, numbers in (((1,), 1), ((1, 2), 4)):  # numbers: as many more as a cubic has
                rss = _rss(np.concatenate([parabola, since ** np.array(powers)], 2), x)
                found.append(self._bic(float(rss.min()) / self.sigma**2, numbers))
            total += min(found)
        return total

    def faults(self, rate: float | None, *, pairs: bool) -> Iterator[_Hypothesis]:
        """What may be wrong with the recording.

        Args:
            rate: Frames per second, where they are regular.
            pairs: Whether frames may be missing in two places.
        """
        for dropped in self._dropped(pairs) if rate else ():
            at, frames = dropped[..., 0], dropped[..., 1]  # (H, places)
            chi2 = np.zeros(len(dropped))
            for _, t, x, _ in self.bodies:
                late = (frames[..., None] * (t > at[..., None])).sum(1) / rate
                chi2 += self._chi2(t + late, x)
            best = int(chi2.argmin())
            places = tuple((self.middle + a, int(n)) for a, n in dropped[best])
            bic = self._bic(float(chi2[best]), len(places)) + PRICE * len(places)
            yield _Hypothesis(float(chi2[best]), len(places), bic, dropped=places)
        yield self._shifted()
        yield from self._swapped()

    def _shifted(self) -> _Hypothesis:
        """All later positions are off by the same."""
        along, size = np.zeros(3), 0.0
        for _, t, x, after in self.bodies:
            cubic = _powers(t, 3)
            step = _rest(cubic, after[:, None] * 1.0)
            along += (step.T @ _rest(cubic, x))[0]
            size += float((step**2).sum())
        chi2 = self.smooth - float(along @ along) / size / self.sigma**2
        occam = 6 * np.log(max(SHIFT_SIGMA * np.sqrt(size) / self.sigma, 1.0))
        return _Hypothesis(chi2, 3, chi2 + occam + PRICE, shift=along / size)

    def _swapped(self) -> Iterator[_Hypothesis]:
        """Two bodies have each other's names later."""
        for (i, t, x, after), (j, u, y, later) in itertools.combinations(self.bodies, 2):
            if len(t) == len(u) and (after == later).all() and np.allclose(t, u):
                crossed = [np.where(after[:, None], b, a) for a, b in ((x, y), (y, x))]
                others = self.smooth - self._chi2(t, x) - self._chi2(u, y)
                chi2 = float(others + sum(self._chi2(t, z) for z in crossed))
                yield _Hypothesis(chi2, 0, chi2 + PRICE, swapped=(i, j))

    def _dropped(self, pairs: bool) -> Iterator[np.ndarray]:
        """Where frames may be missing, (H, places, 2) times since the instant and numbers of frames: at the instant;
        with `pairs`, at a later one nearby, too."""
        yield np.array([[(0.0, n)] for n in range(1, MOST_FRAMES + 1)])
        time = max((t for _, t, _, _ in self.bodies), key=len)
        later = [t for t in (time[1:] + time[:-1]) / 2 if t > 0][:-1]
        if pairs and later:
            few = range(1, MOST_NEARBY + 1)
            yield np.array([[(0.0, n), (t, m)] for t, n, m in itertools.product(later, few, few)])


def _powers(time: np.ndarray, degree: int) -> np.ndarray:
    """(..., n, degree + 1) powers of times (..., n), scaled to 1."""
    return (time / np.abs(time).max())[..., None] ** np.arange(degree + 1)


def _rest(designs: np.ndarray, x: np.ndarray) -> np.ndarray:
    """What linear fits with designs (..., n, k), of which one column is constant, leave of values (n, c)."""
    x = x - x.mean(0)
    across = designs.swapaxes(-1, -2)
    normal = across @ designs
    normal = normal + RIDGE * np.trace(normal, axis1=-1, axis2=-2)[..., None, None] * np.eye(normal.shape[-1])
    return np.asarray(x - designs @ np.linalg.solve(normal, across @ x))


def _rss(designs: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(...) sums of squares of what linear fits leave."""
    return np.asarray((_rest(designs, x) ** 2).sum((-1, -2)))


def _without(
    tracks: tuple[Track, ...], found: _Hypothesis, middle: float
) -> tuple[tuple[Fault, ...], tuple[Track, ...]]:
    """The faults that were found at an instant, and the tracks without them."""
    clip = tracks[0].clip
    later = [t.time > middle for t in tracks]
    if found.dropped:
        interval = 1 / frame_rate(tracks)  # type: ignore[operator]
        late = [sum(n * (t.time > at) for at, n in found.dropped) * interval for t in tracks]
        mended = [replace(t, time=t.time + more) for t, more in zip(tracks, late, strict=True)]
        faults = tuple(Fault("dropped_frames", n, "frames", clip, None, at) for at, n in found.dropped)
        return faults, tuple(mended)
    if found.shift is not None:
        shift = found.shift
        mended = [
            replace(t, position=t.position - after[:, None] * shift) for t, after in zip(tracks, later, strict=True)
        ]
        return (Fault("bumped_camera", float(np.linalg.norm(shift)), "m", clip, None, middle),), tuple(mended)
    assert found.swapped is not None
    i, j = found.swapped
    mended = list(tracks)
    for a, b in ((i, j), (j, i)):
        mended[a] = _continued(tracks[a], tracks[b], middle)
    names = f"{tracks[i].object}, {tracks[j].object}"
    return (Fault("swapped_names", 1, "-", clip, names, middle),), tuple(mended)


def _continued(track: Track, other: Track, middle: float) -> Track:
    """A track that goes on as the other one after an instant."""

    def joined(a: np.ndarray | None, b: np.ndarray | None) -> np.ndarray | None:
        if a is None or b is None:
            return None
        return np.concatenate([a[track.time <= middle], b[other.time > middle]])

    time, position = joined(track.time, other.time), joined(track.position, other.position)
    assert time is not None and position is not None
    return replace(
        track,
        time=time,
        position=position,
        quaternion=joined(track.quaternion, other.quaternion),
        angular_velocity=joined(track.angular_velocity, other.angular_velocity),
        sigma=joined(track.sigma, other.sigma),
    )
