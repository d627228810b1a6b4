"""The simplest region that holds what the known scene does not explain: one condition or two, by description length.

Each sample in which a body moves is inside or outside of an interval. A region that says so of most of them with few
numbers wins. Neighbouring samples err alike, so that a sample counts for a part of one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.where.intervals import Explained, Interval
from pipeline.scene.effects.region import Region

ALIKE_SAMPLES = 3.0  # samples that count as one
BLOW_SAMPLES = 2.5  # a shorter interval is a blow, which has no region
AGREES = 0.75  # F1 of a region and the intervals, below which it is no description of them
EVERYWHERE = 0.9  # share of the time of motion, from which on a region is no part
BALLS = 3  # each at most half as wide as the one before: few paths tell how wide a ball is
ANGLES, PLACES = 36, 9  # tried at first: normals of a plane, and places along each axis of a ball's centre
REFINED = 3  # times that a centre is sought again nearby


@dataclass(frozen=True)
class Samples:
    """S samples of moving bodies.

    Attributes:
        time: (S,) s.
        position: (S, 3) m.
        velocity: (S, 3) m/s.
        clip: (S,) index of the recording.
        object: (S,) index of the object.
        inside: (S,) bool, in an interval.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    clip: np.ndarray
    object: np.ndarray
    inside: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    def where(self, chosen: np.ndarray) -> Samples:
        """The samples chosen, (S,) bool."""
        return Samples(*(getattr(self, k)[chosen] for k in self.__dataclass_fields__))


@dataclass(frozen=True)
class FoundRegion:
    """A region, and how well it says where the known scene fails.

    Attributes:
        region: Empty: everywhere.
        objects: The objects in which it fails; None: all.
        share: Of the time of motion, that is inside.
        agreement: F1 of the region and the intervals, over samples.
    """

    region: Region
    objects: tuple[int, ...] | None
    share: float
    agreement: float


def is_blow(interval: Interval, arc: Arc) -> bool:
    """Whether an interval of an arc is so short that it has no extent."""
    return bool(interval.end - interval.start < BLOW_SAMPLES * np.median(np.diff(arc.time)))


def moving_samples(
    arcs: tuple[Arc, ...], explained: tuple[tuple[Explained, ...], ...], clips: tuple[str, ...], least_speed: float
) -> Samples:
    """The samples at which bodies move, with whether they are in an interval; those in blows are left out."""
    rows = []
    for arc, own in zip(arcs, explained, strict=True):
        used = np.zeros(len(arc.time), bool)
        inside = np.zeros(len(arc.time), bool)
        for part in own:
            used |= np.abs(part.basis).max(1) > 0
            for v in part.intervals:
                at = (arc.time >= v.start) & (arc.time <= v.end)
                if is_blow(v, arc):
                    used &= ~at
                inside |= at
        velocity = smooth_velocity(arc.time, arc.position)
        used &= (np.linalg.norm(velocity, axis=1) > least_speed) | inside
        shape = (len(arc.time),)
        clip, number = np.full(shape, clips.index(arc.clip)), np.full(shape, arc.object)
        rows.append(Samples(arc.time, arc.position, velocity, clip, number, inside).where(used))
    return Samples(*(np.concatenate([getattr(r, k) for r in rows]) for k in Samples.__dataclass_fields__))


def smooth_velocity(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """(T, 3) m/s at times (T,) s and positions (T, 3) m, by parabolas through neighbouring samples."""
    count, half = len(time), 4
    out = np.empty_like(position)
    for k in range(count):
        near = slice(max(0, min(k - half, count - 2 * half - 1)), min(count, max(k + half + 1, 2 * half + 1)))
        t = time[near] - time[k]
        out[k] = np.linalg.lstsq(np.column_stack([np.ones_like(t), t, t * t]), position[near], rcond=None)[0][1]
    return out


def find_regions(samples: Samples, clips: tuple[str, ...]) -> list[FoundRegion]:
    """Regions that explain more of the intervals than their numbers cost, the simplest first.

    They have one condition, or two where the second one is worth its price. clips: names.
    """
    inside = samples.inside
    price = float(np.log(max(len(inside), 1))) / 2 * ALIKE_SAMPLES
    found: list[tuple[float, FoundRegion]] = []

    def add(region: Region, objects: tuple[int, ...] | None, own: np.ndarray, most: float) -> float:
        """The cost of a region of some objects, whose samples are `own` (S,) bool; it is added if it is below most."""
        says = own & _holds(region, samples, clips)
        cost = float((says != inside).sum()) + price * (region.numbers + (objects is not None))
        if cost < most:
            found.append((cost, _judged(region, objects, says, inside)))
        return cost

    nothing = float(inside.sum())
    for objects, own in _by_object(samples) if nothing else ():
        mine = samples.where(own)
        for region in (Region(), *_single(mine, Region(), clips, price)):
            cost = add(region, objects, own, nothing)
            left = mine.where(_holds(region, mine, clips))
            if region.numbers and cost < nothing and left.inside.any() and not left.inside.all():
                for both in _single(left, region, clips, price):
                    add(both, objects, own, cost)
    ranked = [judged for _, judged in sorted(found, key=lambda pair: pair[0])]
    if ranked and ranked[0].share > EVERYWHERE:
        return [_judged(Region(), None, np.ones(len(inside), bool), inside)]
    return ranked


def region_of_law(
    samples: Samples, clips: tuple[str, ...], region: Region, objects: tuple[int, ...] | None
) -> FoundRegion:
    """The region of a law that was found, judged by the intervals. objects: on which it acts; None: all."""
    own = np.ones(len(samples.time), bool) if objects is None else np.isin(samples.object, objects)
    return _judged(region, objects, own & _holds(region, samples, clips), samples.inside)


def _judged(region: Region, objects: tuple[int, ...] | None, says: np.ndarray, inside: np.ndarray) -> FoundRegion:
    """A region with how well it `says` (S,) bool which samples are `inside` (S,) bool an interval."""
    right = float((says & inside).sum())
    return FoundRegion(region, objects, float(says.mean()), 2 * right / max(float(says.sum() + inside.sum()), 1.0))


def _by_object(samples: Samples) -> Iterator[tuple[tuple[int, ...] | None, np.ndarray]]:
    """All objects, and each alone that is in an interval, with its samples (S,) bool."""
    yield None, np.ones(len(samples.time), bool)
    numbers = np.unique(samples.object)
    if len(numbers) > 1:
        for number in numbers:
            own = samples.object == number
            if samples.inside[own].any():
                yield (int(number),), own


def _holds(region: Region, samples: Samples, clips: tuple[str, ...]) -> np.ndarray:
    out = region.holds(samples.time, samples.position, samples.velocity)
    if region.clips is not None:
        out &= np.isin(samples.clip, [clips.index(c) for c in region.clips])
    return np.asarray(out)


def _single(samples: Samples, beside: Region, clips: tuple[str, ...], price: float) -> list[Region]:
    """The region with the best further condition of each kind that it lacks."""
    out, speed = [], samples.speed
    for key, values, above in (
        ("after", samples.time, True),
        ("before", samples.time, False),
        ("faster", speed, True),
        ("slower", speed, False),
    ):
        if getattr(beside, key) is None:
            out.append(replace(beside, **{key: float(_thresholds(values[None], samples.inside, above)[0][0])}))  # type: ignore[arg-type]
    if beside.centre is None:
        widest = np.inf
        for _ in range(BALLS):
            centre, radius = _ball(samples, widest)
            out.append(replace(beside, centre=centre, radius=radius))
            widest = radius / 2
    if beside.normal is None:
        normal, offset = _plane(samples)
        out.append(replace(beside, normal=normal, offset=offset))
    if beside.clips is None:
        numbers = np.arange(len(clips))
        gain = [float((2.0 * samples.inside[samples.clip == k] - 1).sum()) for k in numbers]
        chosen = tuple(clips[k] for k in numbers if gain[k] > price)
        if 0 < len(chosen) < len(clips):
            out.append(replace(beside, clips=chosen))
    return out


def _thresholds(values: np.ndarray, inside: np.ndarray, above: bool) -> tuple[np.ndarray, np.ndarray]:
    """Values above (below) which most samples are inside and beyond which few are, and how many are wrong, (B,) each.

    Args:
        values: (B, S), B numbers of each sample.
        inside: (S,) bool.
        above: Above them.
    """
    order = np.argsort(values if above else -values, axis=1)
    ranked, hit = np.take_along_axis(values, order, 1), inside[order]
    # beyond place k all are said to be inside: wrong are those inside before it, and those outside from it on
    wrong = np.full((len(values), len(inside) + 1), int((~inside).sum()))
    wrong[:, 1:] += np.cumsum(np.where(hit, 1, -1), axis=1)
    k, rows = wrong.argmin(1), np.arange(len(values))
    first, last = ranked[:, 0], ranked[:, -1]
    edge = (ranked[rows, np.maximum(k - 1, 0)] + ranked[rows, np.minimum(k, len(inside) - 1)]) / 2
    edge = np.where(k == 0, 2 * first - last, np.where(k == len(inside), 2 * last - first, edge))
    return edge, wrong[rows, k]


def _ball(samples: Samples, widest: float) -> tuple[tuple[float, ...], float]:
    """Centre and radius of the ball, at most so wide, that says best which samples are inside; a disc where heights do
    not vary."""
    x, on = samples.position, samples.position[samples.inside]
    low, high = on.min(0), on.max(0)
    reach = np.maximum(high - low, 1e-3)
    level = np.ptp(x[:, 2]) < 0.1 * np.ptp(x[:, :2], axis=0).max()
    best = (len(x) + 1, (low + high) / 2, 0.0)
    middle, wide, count = (low + high) / 2, reach, PLACES
    for _ in range(1 + REFINED):
        axes = [middle[c] + wide[c] * np.linspace(-0.75, 0.75, count) for c in range(3)]
        if level:
            axes[2] = np.array([float(np.median(x[:, 2]))])
        places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        radii, wrong = _thresholds(np.linalg.norm(x - places[:, None], axis=2), samples.inside, above=False)
        wrong[radii > widest] = len(x) + 1
        k = int(wrong.argmin())
        if wrong[k] < best[0]:
            best = int(wrong[k]), places[k], float(radii[k])
        middle, wide, count = np.asarray(best[1]), wide * 2 / count, 7
    return tuple(round(float(v), 4) for v in best[1]), round(best[2], 4)


def _plane(samples: Samples) -> tuple[tuple[float, ...], float]:
    """Normal and offset of the plane beyond which samples are inside; an upright one, or a level one."""
    best = (len(samples.time) + 1, np.array([1.0, 0.0, 0.0]), 0.0)
    turns = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)
    for _ in range(1 + REFINED):
        level = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], 1)
        normals = np.concatenate([level, [[0, 0, 1.0], [0, 0, -1.0]]])
        offsets, wrong = _thresholds(normals @ samples.position.T, samples.inside, above=True)
        k = int(wrong.argmin())
        if wrong[k] < best[0]:
            best = int(wrong[k]), normals[k], float(offsets[k])
        step = turns[1] - turns[0]
        turns = np.arctan2(best[1][1], best[1][0]) + step * np.linspace(-0.6, 0.6, 7)
    return tuple(round(float(v), 4) for v in best[1]), round(best[2], 4)
