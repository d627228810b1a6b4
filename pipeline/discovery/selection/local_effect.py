"""An effect that acts in a part of the world, where that explains more than any effect that acts everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.calibration import Calibration, fit_model
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import Progress, completed, with_arc_effect
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.model import OBJECT, Model, with_effect, with_free_region, without_effect
from pipeline.discovery.fitting.possible import is_possible
from pipeline.discovery.fitting.screening import ScreeningRegression
from pipeline.discovery.selection.forward_selection import CLAIM_MORE
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.where.clean_part import CleanPart, find_clean_part
from pipeline.discovery.where.intervals import Interval, intervals_where, is_blow
from pipeline.discovery.where.local_law import LawFits, LocalLaw, Place
from pipeline.discovery.where.path_evidence import Paths, paths_of, smooth_velocity
from pipeline.discovery.where.region_search import FoundRegion, find_regions, region_of_law
from pipeline.scene.effects.kind import EffectKind, local_kind
from pipeline.scene.effects.region import Region
from pipeline.scene.scene import half_extents

MOST_REGIONS, MOST_STARTS = 8, 3  # regions in which laws are sought, and starts from which each one is fitted
MOST_LOCAL = 5  # effects that are fitted to the motion in a region: those that explain most of the paths
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
    paths = _paths(problem, clean)
    regions = tuple(find_regions(paths, problem.clips))
    where = Where(clean, regions[0] if regions else None, regions, float(paths.samples.inside.mean()))
    hit = {arc.clip for k, arc in enumerate(problem.arcs) if any(is_blow(v, arc) for v in where.of_arc(k))}
    some = frozenset(arc.clip for k, arc in enumerate(problem.arcs) if where.of_arc(k))
    return replace(where, blown=tuple(clip for clip in problem.clips if clip in hit), disagreeing=some)


def _paths(problem: Problem, clean: CleanPart) -> Paths:
    return paths_of(problem.arcs, clean, problem.clips, LEAST_SPEED, float(np.log(problem.effective_rows)))


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
    samples = _paths(problem, where.clean).samples
    return replace(where, region=region_of_law(samples, problem.clips, Region(centre=tuple(place), radius=reach), None))


def where_with(found: Candidate, where: Where) -> Where:
    """Where the known scene fails, its free numbers as fitted with an effect that acts in a part.

    The intervals are those in which the law acts and shows, with those that it does not explain.

    Args:
        found: The model with the effect.
        where: As it was found without the effect.
    """
    problem, model = found.problem, where.clean.model
    clean = find_clean_part(problem, model, found.fit.theta[: model.size], known=True)
    covariance = found.fit.covariance[: model.size, : model.size] / problem.floor.information
    region, bodies, paths = _region(found), found.fit.model.effects[-1].bodies, _paths(problem, clean)
    explained = []
    for arc, leftovers, own in zip(problem.arcs, clean.leftovers, clean.explained, strict=True):
        velocity = smooth_velocity(arc.time, arc.position)
        acts = region.holds(arc.time, arc.position, velocity) & (np.linalg.norm(velocity, axis=1) > LEAST_SPEED)
        acts &= (bodies is None or arc.object in bodies) and (region.clips is None or arc.clip in region.clips)
        explained.append(
            tuple(
                intervals_where(arc.time, left.path, left.weight, acts, part.intervals, paths.price)
                for left, part in zip(leftovers, own, strict=True)
            )
        )
    told = region_of_law(paths.samples, problem.clips, region, bodies)
    clean = replace(clean, covariance=covariance, explained=tuple(explained))
    return Where(clean, told, (), float(_paths(problem, clean).samples.inside.mean()))


def _region(found: Candidate) -> Region:
    """The region of a model's last effect, that of a blow with the time of a sample about it."""
    kind = found.fit.model.effects[-1]
    region, column = only_of(found, kind.name) or Region(), found.fit.model.column(kind.name, "time")
    if kind.kick is None or column is None:
        return region
    time, half = float(found.fit.theta[column]), float(np.median(np.diff(found.problem.arcs[0].time))) / 2
    return replace(region, after=time - half, before=time + half)


def local_effects(
    calibration: Calibration, where: Where, kinds: Sequence[EffectKind], progress: Progress
) -> list[Candidate]:
    """Models of one effect that acts in a part of the world, of a blow in some recordings, and of both, the best first.

    Laws and regions are fitted to what the clean part leaves of the paths, from the regions in which the known scene
    fails; those that explain most of it are fitted to the motion, with the region's numbers.

    Args:
        calibration: Of the problem.
        where: Where the known scene fails.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    none, problem = calibration.none, calibration.problem
    model, theta = none.fit.model, where.clean.theta
    pairs = zip(problem.stacks, none.fit.starts, strict=True)
    starts = [fit_initial_states(stack, model, theta, start)[0] for stack, start in pairs]
    base = replace(none, fit=replace(none.fit, theta=theta, starts=starts))
    # a law that acts in some recordings only could explain a fault of these recordings
    places: list[Place] = [(r.region, r.objects) for r in where.regions if r.region.clips is None][:MOST_REGIONS]
    # a law of one body may act everywhere, though it shows in a part only
    bodies = dict.fromkeys(b for _, b in places if b is not None)
    places += [(Region(), b) for b in bodies if (Region(), b) not in places]
    forces = [kind for kind in kinds if kind.may_be_local and kind.discovery.gravity_scale is None]
    fits = LawFits.of(_as_calibrated(problem, model, theta), model, theta, _paths(problem, where.clean))
    bases = [base, *_with_blows(calibration, where, base, kinds)]
    simple, double = ([p for p in places if (p[0].conditions < 2) is few] for few in (True, False))
    laws = [law for kind in forces if (law := fits.best(kind, simple, MOST_STARTS)) is not None]
    found: dict[EffectKind, Candidate] = {}

    def add(law: LocalLaw | None) -> None:
        if law is not None:
            progress(law.kind.name)
            tried = [_with_law(calibration, beside, law) for beside in bases]
            old = [found[law.kind]] if law.kind in found else []
            found[law.kind] = min([*old, *tried], key=_with_claims)

    for law in sorted(laws, key=lambda law: -law.gain)[:MOST_LOCAL]:
        add(law)
    if found:
        kind = min(found, key=lambda kind: _with_claims(found[kind]))
        add(fits.best(kind, double, MOST_STARTS))
        there = only_of(found[kind], kind.name) or Region(), found[kind].fit.model.effects[-1].bodies
        for other in [k for k in found if k is not kind]:
            add(fits.best(other, [there], 1, stay=True))
    return sorted(filter(is_possible, [*bases[1:], *found.values()]), key=_with_claims)


def _with_claims(found: Candidate) -> float:
    """A model's score with what each of its effects has to win by."""
    return found.score + CLAIM_MORE * len(found.effects)


def _with_law(calibration: Calibration, base: Candidate, law: LocalLaw) -> Candidate:
    """`base` with a law that acts in a region, fitted to the motion with the region's numbers."""
    acting = local_kind(law.kind, law.region, law.objects)
    model = with_free_region(with_effect(base.fit.model, acting, calibration.problem.known), law.region)
    theta = np.concatenate([base.fit.theta, np.tile(law.numbers, len(law.objects or (0,)))])
    theta = np.append(theta, model.start[len(theta) :])
    effects = (*base.effects, law.kind.name)
    found = fit_model(calibration, base.problem, model, theta, base.fit.starts, effects=effects)
    return _priced(calibration, completed(calibration, found, calibration.none))


def _with_blows(
    calibration: Calibration, where: Where, base: Candidate, kinds: Sequence[EffectKind]
) -> list[Candidate]:
    """`base` with a blow in the recordings that it explains; none where nothing is hit, or something is in all."""
    blows = _blows(where, kinds, base.problem)
    if not blows:
        return []
    screening = ScreeningRegression(calibration.problem, base.fit)
    found = (with_arc_effect(calibration, kind, base, screening.guesses(kind)) for kind in blows)
    return [_in_its_recordings(calibration, c) for c in found if c is not None]


def _blows(where: Where, kinds: Sequence[EffectKind], problem: Problem) -> list[EffectKind]:
    """The blows that may be named, in the recordings in which something is hit; none where that is in all."""
    some = Region(clips=where.blown)
    return [local_kind(k, some) for k in kinds if k.kick is not None and 0 < len(where.blown) < len(problem.clips)]


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
