"""An effect that acts in a part of the world, where that explains more than any effect that acts everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.calibration import LEAST_BETTER, Calibration, fit_model
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import Progress, completed, with_arc_effect
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.model import OBJECT, Model, with_effect, with_free_region, without_effect
from pipeline.discovery.fitting.possible import is_possible
from pipeline.discovery.fitting.screening import ScreeningRegression
from pipeline.discovery.selection.comparison import ALIKE
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.where.clean_part import CleanPart, find_clean_part
from pipeline.discovery.where.intervals import Interval
from pipeline.discovery.where.region_search import (
    AGREES,
    FoundRegion,
    find_regions,
    is_blow,
    moving_samples,
    region_of_law,
)
from pipeline.scene.effects.kind import EffectKind, local_kind
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import half_extents

MOST_REGIONS = 5  # descriptions in which effects are sought
BLURS = (8.0, 1.0)  # steps of an integration, by which a region's edges are blurred, one after the other
MOST_LOCAL = 5  # effects that are fitted in a region: the most promising in the screening regression
Place = tuple[Region, tuple[int, ...] | None]
"""A region, and the objects in it; None: all."""
LEAST_SPEED = 0.05  # m/s: where a slower body is tells nothing of what acts on it


@dataclass(frozen=True)
class Where:
    """Where the known scene fails.

    Attributes:
        clean: The part in which it holds, and the intervals of the rest.
        region: The simplest description of the intervals, or where the law acts that explains them; None where none
            agrees.
        regions: Where the intervals may be, the simplest first; none where there are no intervals.
        share: Of the time of motion, that is in intervals.
        blown: Names of the recordings in which something is hit.
        disagreeing: Names of those that have intervals.
    """

    clean: CleanPart
    region: FoundRegion | None
    regions: tuple[FoundRegion, ...]
    share: float
    blown: tuple[str, ...] = ()
    disagreeing: frozenset[str] = frozenset()

    def of_arc(self, index: int) -> tuple[Interval, ...]:
        """The intervals of one arc of the problem."""
        return tuple(v for part in self.clean.explained[index] for v in part.intervals)

    @property
    def intervals(self) -> tuple[Interval, ...]:
        """Of all arcs."""
        return tuple(v for k in range(len(self.clean.explained)) for v in self.of_arc(k))

    @property
    def mostly_clean(self) -> bool:
        """Whether something acts, and most of the time nothing does."""
        return bool(self.intervals) and self.share < 0.5

    def in_all(self, clips: Sequence[str]) -> bool:
        """Whether each of these recordings has intervals."""
        return self.disagreeing >= set(clips)

    @property
    def has_clean_part(self) -> bool:
        """Whether the scene holds somewhere."""
        return self.region is None or self.local

    @property
    def local(self) -> bool:
        """Whether the scene fails in a part only."""
        regions = (*self.regions, *([] if self.region is None else [self.region]))
        return bool(self.blown) or any(r.region.numbers > 0 or r.objects is not None for r in regions)


def find_where(none: Candidate) -> Where:
    """Where the known scene fails: nowhere, if the calibrated model explains more than intervals do.

    Args:
        none: The calibrated model.
    """
    problem, clean = none.problem, _clean_part(none)
    samples = moving_samples(problem.arcs, clean.explained, problem.clips, LEAST_SPEED)
    regions = tuple(find_regions(samples, problem.clips))
    best = next((found for found in regions if found.agreement >= AGREES), None)
    where = Where(clean, best, regions, float(samples.inside.mean()))
    hit = {arc.clip for k, arc in enumerate(problem.arcs) if any(is_blow(v, arc) for v in where.of_arc(k))}
    some = frozenset(arc.clip for k, arc in enumerate(problem.arcs) if where.of_arc(k))
    return replace(where, blown=tuple(clip for clip in problem.clips if clip in hit), disagreeing=some)


def intervals_left(found: Candidate) -> bool:
    """Whether a fitted model fails in some intervals."""
    return any(part.intervals for arc in _clean_part(found, known=True).explained for part in arc)


def _clean_part(found: Candidate, known: bool = False) -> CleanPart:
    """The part in which a model holds: all, if it explains more than intervals do. known: its numbers are known."""
    problem = found.problem
    clean = find_clean_part(problem, found.fit.model, found.fit.theta, known)
    if found.position_chi2 * problem.floor.information > clean.chi2:
        return clean
    covariance = found.fit.covariance / problem.floor.information
    return replace(clean.without_intervals, theta=found.fit.theta, covariance=covariance)


def where_hit(found: Candidate, problem: Problem, where: Where) -> Where:
    """Where the known scene fails because of a hidden obstacle: as near to its centre as those of bodies come in a hit.

    Args:
        found: The model, fitted to arcs that are cut at the hits.
        problem: With arcs that are not.
        where: As it was found without the model.
    """
    assert found.hits is not None
    place, size = found.hits.values["position"], found.hits.values["size"]
    assert isinstance(place, list) and isinstance(size, float)
    way = max(float(np.linalg.norm(np.diff(arc.position, axis=0), axis=1).max()) for arc in problem.arcs)  # of a sample
    reach = size + max(float(half_extents(o).max()) for o in problem.known.scene.objects) + way / 2
    samples = moving_samples(problem.arcs, where.clean.explained, problem.clips, LEAST_SPEED)
    return replace(where, region=region_of_law(samples, problem.clips, Region(centre=tuple(place), radius=reach), None))


def where_with(found: Candidate, where: Where) -> Where:
    """Where the known scene fails, its free numbers as fitted with an effect that acts in a part.

    Args:
        found: The model with the effect.
        where: As it was found without the effect.
    """
    problem, model = found.problem, where.clean.model
    clean = find_clean_part(problem, model, found.fit.theta[: model.size], known=True)
    covariance = found.fit.covariance[: model.size, : model.size] / problem.floor.information
    samples = moving_samples(problem.arcs, clean.explained, problem.clips, LEAST_SPEED)
    region = region_of_law(samples, problem.clips, _first_region(found), found.fit.model.effects[0].bodies)
    return Where(replace(clean, covariance=covariance), region, (), float(samples.inside.mean()))


def _first_region(found: Candidate) -> Region:
    """The region of a model's first effect, that of a blow with the time of a sample about it."""
    kind = found.fit.model.effects[0]
    region, column = only_of(found, kind.name) or Region(), found.fit.model.column(kind.name, "time")
    if kind.kick is None or column is None:
        return region
    time, half = float(found.fit.theta[column]), float(np.median(np.diff(found.problem.arcs[0].time))) / 2
    return replace(region, after=time - half, before=time + half)


def local_effects(
    calibration: Calibration, where: Where, kinds: Sequence[EffectKind], progress: Progress
) -> list[Candidate]:
    """Models of one effect that acts in the region in which the known scene fails, the best first.

    Each effect is screened in each region that describes the intervals, and blows in the recordings that have some;
    those that promise most are fitted. The best one is fitted in each region with the region's numbers, and the others
    in the region that wins.

    Args:
        calibration: Of the problem.
        where: With regions.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    none, problem = calibration.none, calibration.problem
    model, theta = none.fit.model, where.clean.theta
    pairs = zip(problem.stacks, none.fit.starts, strict=True)
    starts = [fit_initial_states(stack, model, theta, start)[0] for stack, start in pairs]
    base = replace(none, fit=replace(none.fit, theta=theta, starts=starts))
    # a law that acts in some recordings only could explain a fault of these recordings
    regions = [found for found in where.regions if found.region.clips is None]
    places: list[Place] = [(found.region, found.objects) for found in regions[:MOST_REGIONS]]
    # a law of one body may act everywhere, though it shows in a part only
    places += [(Region(), bodies) for bodies in dict.fromkeys(b for _, b in places if b is not None)]
    forces = [kind for kind in kinds if kind.may_be_local and kind.discovery.gravity_scale is None]
    local = [local_kind(kind, *place) for place in places for kind in forces]
    screening = ScreeningRegression(_as_calibrated(problem, model, theta), base.fit)
    screened = [(kind, screening.guesses(kind)) for kind in [*local, *_blows(where, kinds, problem)]]
    screened.sort(key=lambda pair: _price(calibration, pair[0]) - pair[1][0].gain * calibration.information)
    found: dict[str, Candidate] = {}
    for kind, guesses in screened:
        if len(found) < MOST_LOCAL and kind.name not in found:
            progress(kind.name)
            single = with_arc_effect(calibration, kind, base, guesses)
            if single is not None and is_possible(single):
                found[kind.name] = _priced(calibration, single)
    blows = [_in_its_recordings(calibration, c) for c in found.values() if _is_blow(c)]
    return sorted(filter(is_possible, [*blows, *_in_best_place(calibration, found, places)]), key=lambda c: c.score)


def with_blow(
    calibration: Calibration, where: Where, singles: Sequence[Candidate], kinds: Sequence[EffectKind]
) -> Candidate | None:
    """The best model of one effect in a region with a blow beside it; None where there is none, or nothing was hit.

    Args:
        calibration: Of the problem.
        where: Where the known scene fails.
        singles: Models of one effect, the best first.
        kinds: The effects that may be named.
    """
    found = next((c for c in singles if not _is_blow(c)), None)
    if found is None:
        return None
    screening = ScreeningRegression(calibration.problem, found.fit)
    both = [
        with_arc_effect(calibration, kind, found, screening.guesses(kind))
        for kind in _blows(where, kinds, calibration.problem)
    ]
    best = min((c for c in both if c is not None), key=lambda c: c.score, default=None)
    return None if best is None else _in_its_recordings(calibration, best)


def _blows(where: Where, kinds: Sequence[EffectKind], problem: Problem) -> list[EffectKind]:
    """The blows that may be named, in the recordings in which something is hit; none where that is in all."""
    some = Region(clips=where.blown)
    return [local_kind(k, some) for k in kinds if k.kick is not None and 0 < len(where.blown) < len(problem.clips)]


def _is_blow(found: Candidate) -> bool:
    return any(kind.kick is not None for kind in found.fit.model.effects)


def _in_best_place(
    calibration: Calibration, found: Mapping[str, Candidate], places: Sequence[Place]
) -> list[Candidate]:
    """Each model of one effect, in the region in which the best of them fits best; the region's numbers are fitted,
    too."""
    singles = sorted((c for c in found.values() if not _is_blow(c)), key=lambda c: c.score)
    if not singles:
        return []
    first, *others = singles
    placed = sorted((_placed(calibration, first, place) for place in places), key=lambda c: c.score)
    near = [c for c in placed if c.score < placed[0].score + ALIKE]
    # of regions that fit alike the smallest: the data do not show the law beyond it
    best = min(near, key=lambda c: _extent(only_of(c, c.name)))
    while (again := _refitted(calibration, best, best.fit.model, best.fit.theta)).score < best.score - LEAST_BETTER:
        best = again
    (kind,) = best.fit.model.effects
    there = best.fit.model.region(kind, best.fit.theta) or Region(), kind.bodies
    return [best, *(min(c, _placed(calibration, c, there), key=lambda c: c.score) for c in others)]


def _extent(region: Region | None) -> tuple[float, float]:
    """How many numbers a region has, and how wide its ball is, m; no region is the widest."""
    if region is None:
        return np.inf, 0.0
    return region.numbers, float(region.radius)


def _in_its_recordings(calibration: Calibration, found: Candidate) -> Candidate:
    """A model whose last effect is a blow, fitted again with the blow in each recording that it explains."""
    problem = found.problem
    for _ in range(len(problem.clips)):
        model, theta = found.fit.model, found.fit.theta
        *rest, kind = model.effects
        assert kind.only is not None
        without, kept = without_effect(model, kind.name)
        everywhere = replace(model, effects=(*rest, replace(kind, only=Region())))
        gains = dict.fromkeys(problem.clips, 0.0)
        for stack, start in zip(problem.stacks, found.fit.starts, strict=True):
            gain = fit_initial_states(stack, without, theta[kept], start)[1]
            gain -= fit_initial_states(stack, everywhere, theta, start)[1]
            for clip, own in zip(stack.clip, gain, strict=True):
                gains[clip] += own
        clips = tuple(clip for clip, gain in gains.items() if gain > 0)
        if not clips or clips == kind.only.clips:
            break
        again = replace(model, effects=(*rest, replace(kind, only=Region(clips=clips))))
        found = _refitted(calibration, found, again, theta)
    return found


def _as_calibrated(problem: Problem, model: Model, theta: np.ndarray) -> Problem:
    """The problem whose known scene states the frictions of theta (G,)."""
    scene = problem.known.scene
    columns = [model.column(f"{OBJECT}{k}", "sliding_friction") for k in range(len(scene.objects))]
    objects = tuple(
        o if column is None else replace(o, sliding_friction=float(theta[column]))
        for o, column in zip(scene.objects, columns, strict=True)
    )
    return replace(problem, known=replace(problem.known, scene=replace(scene, objects=objects)))


def _placed(calibration: Calibration, found: Candidate, place: Place) -> Candidate:
    """A model of one effect, fitted again in another region, whose numbers are fitted, too.

    Which paths enter a region changes by steps with its numbers, so its edges are blurred at first.
    """
    none, (kind,) = calibration.none.fit.model, found.fit.model.effects
    region, bodies = place
    theta = found.fit.theta[: none.size + kind.size]
    for blur in BLURS:
        acting = local_kind(effect_kinds()[kind.name], region, bodies, blur)
        model = with_free_region(with_effect(none, acting, calibration.problem.known), region)
        found = _refitted(calibration, found, model, np.append(theta, model.start[len(theta) :]))
        theta = found.fit.theta
    return found


def _refitted(calibration: Calibration, found: Candidate, model: Model, theta: np.ndarray) -> Candidate:
    """A model of an effect in a region, fitted from theta (G,) and the initial states of another one."""
    again = fit_model(calibration, found.problem, model, theta, found.fit.starts, effects=found.effects)
    return _priced(calibration, completed(calibration, again, calibration.none))


def only_of(found: Candidate, effect: str) -> Region | None:
    """Where an effect of a model acts; None: everywhere, or on some bodies only."""
    regions = (found.fit.model.region(k, found.fit.theta) for k in found.fit.model.effects if k.name == effect)
    return next((region for region in regions if region is not None and region.numbers), None)


def _price(calibration: Calibration, kind: EffectKind) -> float:
    """BIC's price of the numbers of an effect and of its region; of a choice of recordings it is a bit for each."""
    assert kind.only is not None
    bits = len(calibration.problem.clips) if kind.only.clips is not None else 0
    rows = float(np.log(calibration.problem.effective_rows))
    return (kind.size + len(kind.only.free)) * rows + 2 * bits * float(np.log(2))


def _priced(calibration: Calibration, found: Candidate) -> Candidate:
    """A model with the price of its region, as far as its numbers are not fitted."""
    paid = (found.fit.model.size - calibration.none.fit.model.size) * float(np.log(calibration.problem.effective_rows))
    price = sum(_price(calibration, kind) for kind in found.fit.model.effects) - paid
    return replace(found, score=found.score + price, bic=found.bic + price)
