"""The region in which an unknown force explains most of what the known scene leaves, at the least price of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import numpy as np

from pipeline.discovery.where.path_evidence import LAWS, Paths, Samples, SimpleForces
from pipeline.scene.effects.region import LIMITS, Region

EDGES, CENTRES = 24, 125  # tried at first: edges, and as many headings of a plane; centres of balls
RADII = 8  # tried at first, each the same factor wider
HALVINGS = 5  # of the steps by which the numbers of a region are then improved


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


@dataclass(frozen=True)
class Tried:
    """A region with the evidence for a force in it, less the price of all numbers and of the choice among `choices`."""

    region: Region
    objects: tuple[int, ...] | None
    gain: float
    choices: int


def find_regions(paths: Paths, clips: tuple[str, ...]) -> list[FoundRegion]:
    """Regions in which a force explains more than its numbers cost, the best first; only `everywhere` if it is.

    They have one condition, or two where the second one is worth its price. clips: names of the recordings.
    """
    found: list[Tried] = []
    forces = SimpleForces(paths)
    numbers = np.unique(paths.samples.object)
    for objects in (None, *((int(n),) for n in numbers if len(numbers) > 1)):
        search = RegionSearch(paths, forces, clips, objects)
        singles = search.best(Region(), len(LAWS))
        if objects is None and len(clips) > 1:
            some = [tuple(c for c, yes in zip(clips, chosen, strict=True) if yes) for chosen in forces.recordings()]
            part = [Region(clips=names) for names in dict.fromkeys(some) if 0 < len(names) < len(clips)]
            singles += search.tried(part, len(LAWS))
        found += singles
        first = max(singles, key=_gain)
        if first.region.numbers:
            for both in search.best(first.region, first.choices):
                found.append(max([first, *search.tried(_simpler(both.region), first.choices), both], key=_gain))
    ranked = sorted({f for f in found if f.gain > 0}, key=lambda f: -f.gain)
    if ranked and ranked[0].region == Region() and ranked[0].objects is None:
        ranked = ranked[:1]
    return [region_of_law(paths.samples, clips, f.region, f.objects) for f in ranked]


def _gain(tried: Tried) -> float:
    return tried.gain


def _simpler(region: Region) -> list[Region]:
    """The region without each one of its conditions."""
    names = [name for name in (*LIMITS, "centre", "normal", "clips") if getattr(region, name) is not None]
    return [replace(region, **{name: None}) for name in names]  # type: ignore[arg-type]


def region_of_law(
    samples: Samples, clips: tuple[str, ...], region: Region, objects: tuple[int, ...] | None
) -> FoundRegion:
    """The region of a law that was found, judged by the intervals. objects: on which it acts; None: all."""
    says, inside = samples_inside(samples, clips, region, objects), samples.inside
    right = float((says & inside).sum())
    return FoundRegion(region, objects, float(says.mean()), 2 * right / max(float(says.sum() + inside.sum()), 1.0))


def samples_inside(
    samples: Samples, clips: tuple[str, ...], region: Region, objects: tuple[int, ...] | None
) -> np.ndarray:
    """(S,) bool, the samples of some objects (None: all) in a region. clips: names of the recordings."""
    out = region.holds(samples.time, samples.position, samples.velocity)
    if region.clips is not None:
        out = out & np.isin(samples.clip, [clips.index(c) for c in region.clips])
    if objects is not None:
        out = out & np.isin(samples.object, objects)
    return np.asarray(out)


class Forces(Protocol):
    """Forces that may act in a region."""

    def gains(self, inside: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """As `SimpleForces.gains`."""


@dataclass(frozen=True)
class RegionSearch:
    """The search for regions of some objects.

    Attributes:
        paths: What is to be explained.
        forces: By which.
        clips: Names of the recordings.
        objects: None: all.
    """

    paths: Paths
    forces: Forces
    clips: tuple[str, ...]
    objects: tuple[int, ...] | None

    def inside(self, region: Region) -> np.ndarray:
        """(S,) bool, the objects' samples in a region."""
        return samples_inside(self.paths.samples, self.clips, region, self.objects)

    def best(self, beside: Region, choices: int) -> list[Tried]:
        """The best region with one more condition of each kind that `beside` lacks; without conditions also itself.

        choices: Among which `beside` was chosen.
        """
        out = [] if beside.numbers else self.tried([beside], choices)
        for regions in _grids(self.paths.samples.where(self.inside(beside)), beside):
            out.append(self.improved(max(self.tried(regions, choices * len(regions)), key=_gain)))
        return out

    def tried(self, regions: Sequence[Region], choices: int) -> list[Tried]:
        """The regions with their evidence."""
        if not regions:
            return []
        inside, nowhere = np.stack([self.inside(region) for region in regions]), (np.nan,) * 3
        gains = self.forces.gains(inside, np.array([region.centre or nowhere for region in regions]))
        numbers = [region.numbers + (self.objects is not None) for region in regions]
        paid = self.paths.price * np.array(numbers) + 2 * np.log(choices)
        return [Tried(r, self.objects, float(gain), choices) for r, gain in zip(regions, gains - paid, strict=True)]

    def improved(self, found: Tried) -> Tried:
        """A region whose numbers are moved by steps that get smaller, as long as that explains more."""
        steps = _steps(found.region, self.paths.samples)
        for halving in range(HALVINGS if steps else 0):
            moves = product((-1, 0, 1), repeat=len(steps))
            near = [
                _moved(found.region, {k: m * s / 2**halving for m, (k, s) in zip(move, steps.items(), strict=True)})
                for move in moves
            ]
            found = max([found, *self.tried(near, found.choices)], key=_gain)
        return found


def _moved(region: Region, by: dict[str, float]) -> Region:
    """A region with numbers that are moved: those of LIMITS, x, y, z and radius of a ball, offset and heading."""
    out = replace(region, **{k: getattr(region, k) + by[k] for k in (*LIMITS, "radius", "offset") if k in by})
    if "x" in by and out.centre is not None:
        out = replace(out, centre=tuple(c + by.get(k, 0.0) for c, k in zip(out.centre, "xyz", strict=True)))
    if "heading" in by and out.normal is not None:
        angle = np.arctan2(out.normal[1], out.normal[0]) + by["heading"]
        out = replace(out, normal=(float(np.cos(angle)), float(np.sin(angle)), 0.0))
    return out


def _is_level(x: np.ndarray) -> bool:
    """Whether positions (S, 3) m vary little in height."""
    return bool(np.ptp(x[:, 2]) < 0.1 * np.ptp(x[:, :2], axis=0).max())


def _steps(region: Region, samples: Samples) -> dict[str, float]:
    """Steps by which the numbers of a region are improved at first, about half of the distances of a grid."""
    x = samples.position
    size = np.ptp(x, axis=0)
    width = float(np.linalg.norm(size))
    out = {k: float(np.ptp(_values(k, samples))) / EDGES for k in LIMITS if getattr(region, k) is not None}
    if region.centre is not None:
        axes = "xy" if _is_level(x) else "xyz"
        out |= {k: float(size["xyz".index(k)]) / CENTRES ** (1 / len(axes)) / 2 for k in axes}
        out["radius"] = width / EDGES
    if region.normal is not None:
        out["offset"] = width / EDGES / 2
        if region.normal[2] == 0:
            out["heading"] = np.pi / EDGES
    return out


def _values(limit: str, samples: Samples) -> np.ndarray:
    """(S,) what a limit is of."""
    return samples.time if limit in ("after", "before") else np.linalg.norm(samples.velocity, axis=1)


def _grids(samples: Samples, beside: Region) -> Iterator[list[Region]]:
    """Regions with one more condition, of each kind that `beside` lacks."""
    if not len(samples.time):
        return
    shares = (np.arange(EDGES) + 0.5) / EDGES
    for name in LIMITS:
        if getattr(beside, name) is None:
            edges = np.quantile(_values(name, samples), shares)
            yield [replace(beside, **{name: float(e)}) for e in edges]  # type: ignore[arg-type]
    x = samples.position
    low, high, level = x.min(0), x.max(0), _is_level(x)
    if beside.centre is None:
        count = round(CENTRES ** (1 / (2 if level else 3)))
        axes = [np.linspace(low[c], high[c], count) for c in range(3)]
        if level:
            axes[2] = np.array([float(np.median(x[:, 2]))])
        radii = float(np.linalg.norm(high - low)) * 2.0 ** -np.arange(1, RADII / 2 + 1, 0.5)
        yield [replace(beside, centre=tuple(map(float, c)), radius=float(r)) for *c, r in product(*axes, radii)]
    if beside.normal is None:
        turns = np.linspace(0, 2 * np.pi, EDGES, endpoint=False)
        upright = [(float(np.cos(a)), float(np.sin(a)), 0.0) for a in turns]
        for normals in (upright, [] if level else [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]):
            offsets = [(n, e) for n in normals for e in np.quantile(x @ np.array(n), shares)]
            if offsets:
                yield [replace(beside, normal=n, offset=float(e)) for n, e in offsets]
