"""An effect that acts in a part of the world, where that explains more than any effect that acts everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pipeline.discrepancy.fitting.calibration import Calibration, fit_model
from pipeline.discrepancy.fitting.candidate import Candidate
from pipeline.discrepancy.fitting.extension import Progress, completed, extend
from pipeline.discrepancy.fitting.least_squares import fit_initial_states
from pipeline.discrepancy.where.clean_part import CleanPart, find_clean_part
from pipeline.discrepancy.where.intervals import Interval
from pipeline.discrepancy.where.region_search import FoundRegion, find_region, moving_samples, region_of_law
from pipeline.scene.effects.kind import EffectKind, local_kind
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds

MOST_LOCAL = 5  # effects that are fitted in a region: the most promising in the screening regression
SCALES = (1.0, 0.4)  # of the steps by which a region's numbers are refined, one after the other
LEAST_SPEED = 0.05  # m/s: where a slower body is tells nothing of what acts on it


@dataclass(frozen=True)
class Where:
    """Where the known scene fails.

    Attributes:
        clean: The part in which it holds, and the intervals of the rest.
        region: The simplest description of the intervals; None where there are none, or none that agrees.
        share: Of the time of motion, that is in intervals.
    """

    clean: CleanPart
    region: FoundRegion | None
    share: float

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

    @property
    def has_clean_part(self) -> bool:
        """Whether the scene holds somewhere."""
        return self.region is None or self.local

    @property
    def local(self) -> bool:
        """Whether the scene fails in a part only."""
        return self.region is not None and (self.region.region.numbers > 0 or self.region.objects is not None)


def find_where(none: Candidate) -> Where:
    """Where the known scene fails: nowhere, if the calibrated model explains more than intervals do.

    Args:
        none: The calibrated model.
    """
    problem = none.problem
    clean = find_clean_part(problem, none.fit.model, none.fit.theta)
    if none.position_chi2 * problem.floor.information <= clean.chi2:
        clean = find_clean_part(problem, none.fit.model, none.fit.theta, known=True).without_intervals
    samples = moving_samples(problem.arcs, clean.explained, problem.clips, LEAST_SPEED)
    return Where(clean, find_region(samples, problem.clips), float(samples.inside.mean()))


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
    bodies = next(kind.bodies for kind in found.fit.model.effects)
    region = region_of_law(samples, problem.clips, only_of(found) or Region(), bodies)
    return Where(replace(clean, covariance=covariance), region, float(samples.inside.mean()))


def local_effects(
    calibration: Calibration, where: Where, kinds: Sequence[EffectKind], progress: Progress
) -> list[Candidate]:
    """Models of one effect that acts in the region in which the known scene fails, the best first.

    Args:
        calibration: Of the problem.
        where: With a region.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    assert where.region is not None
    none, problem = calibration.none, calibration.problem
    model, theta = none.fit.model, where.clean.theta
    pairs = zip(problem.stacks, none.fit.starts, strict=True)
    starts = [fit_initial_states(stack, model, theta, start)[0] for stack, start in pairs]
    base = replace(none, fit=replace(none.fit, theta=theta, starts=starts))
    region = where.region.region
    physical = [kind for kind in kinds if kind.may_be_local and kind.discovery.gravity_scale is None]
    bodies = where.region.objects
    parts = [[local_kind(k, region, bodies) for k in physical if k.discovery.local is local] for local in (True, False)]
    found = [c for part in parts for c in extend(calibration, base, part, progress, MOST_LOCAL)]
    singles = sorted((_priced(calibration, c, region) for c in found), key=lambda c: c.score)
    out: list[Candidate] = []
    for single in singles:
        begin = region
        if out:
            # A region that is somewhat wrong costs each effect about as much.
            gained = singles[0].score - out[0].score
            if single.score - 3 * gained >= min(c.score for c in out):
                out.append(single)
                continue
            refined = only_of(out[0]) or region  # it may suit this effect, too
            there = _in_region(calibration, single, refined)
            if there.score < single.score:
                single, begin = there, refined
        out.append(_refined(calibration, single, begin))
    if bodies is not None:  # of one body the law may hold everywhere, though it shows in a part
        out += [_in_region(calibration, c, Region()) for c in sorted(out, key=lambda c: c.score)[:MOST_LOCAL]]
    return sorted(out, key=lambda c: c.score)


def only_of(found: Candidate) -> Region | None:
    """Where the effect of a model acts; None: everywhere, on some bodies only, or without an effect."""
    regions = (kind.only for kind in found.fit.model.effects if kind.only is not None and kind.only.numbers)
    return next(regions, None)


def _priced(calibration: Calibration, found: Candidate, region: Region) -> Candidate:
    """A model with the price of its region's numbers."""
    price = region.numbers * float(np.log(calibration.problem.effective_rows))
    return replace(found, score=found.score + price, bic=found.bic + price)


def _refined(calibration: Calibration, found: Candidate, region: Region) -> Candidate:
    """A model with its region's numbers moved to where the model fits best, one after the other."""
    steps = {"after": 0.02, "before": 0.02, "faster": 0.03, "slower": 0.03}
    moves: list[Callable[[Region, float], Region]] = [
        partial(_moved, name=name, step=step) for name, step in steps.items() if getattr(region, name) is not None
    ]
    if region.centre is not None:
        moves.append(partial(_moved, name="radius", step=0.02))
    if region.normal is not None:
        moves.append(partial(_moved, name="offset", step=0.02))
    if region.centre is not None:
        moves += [partial(_moved, name="centre", step=0.02, axis=axis) for axis in (0, 1)]
    if region.normal is not None and abs(region.normal[2]) < 0.5:  # an upright plane
        moves.append(partial(_moved, name="normal", step=0.05))
    best, here = found, region
    for scale in SCALES:
        for move in moves:
            for sign in (scale, -scale):
                there = move(here, sign)
                again = _in_region(calibration, best, there)
                while again.score < best.score:
                    best, here = again, there
                    there = move(here, sign)
                    again = _in_region(calibration, best, there)
    return best


def _moved(region: Region, by: float, *, name: str, step: float, axis: int = 0) -> Region:
    """The region with one number changed by so many steps."""
    if name == "centre":
        assert region.centre is not None
        place = [*region.centre]
        place[axis] += by * step
        return replace(region, centre=tuple(place))
    if name == "normal":
        assert region.normal is not None
        angle = float(np.arctan2(region.normal[1], region.normal[0])) + by * step
        return replace(region, normal=(float(np.cos(angle)), float(np.sin(angle)), 0.0))
    return replace(region, **{name: getattr(region, name) + by * step})


def _in_region(calibration: Calibration, found: Candidate, region: Region) -> Candidate:
    """A model fitted again with its effect in another region."""
    model = found.fit.model
    effects = tuple(local_kind(effect_kinds()[kind.name], region, kind.bodies) for kind in model.effects)
    again = fit_model(
        calibration,
        found.problem,
        replace(model, effects=effects),
        found.fit.theta,
        found.fit.starts,
        effects=found.effects,
    )
    return _priced(calibration, completed(calibration, again, calibration.none), region)
