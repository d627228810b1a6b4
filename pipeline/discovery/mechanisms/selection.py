"""Which effects a log supports: the selection of free bodies, on models of a mechanism."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.extension import CLAIM, MOST_FITTED
from pipeline.discovery.mechanisms.candidate import Candidate, Noise, excess_z, noise_of
from pipeline.discovery.mechanisms.free_numbers import FreeNumber
from pipeline.discovery.mechanisms.gap import measure_gap
from pipeline.discovery.mechanisms.kind import MechanismEffect
from pipeline.discovery.mechanisms.law_model import LawModel
from pipeline.discovery.mechanisms.places import may_act
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.search import MechanismSearch, best_of_each, shows
from pipeline.discovery.mechanisms.simulation import Simulator
from pipeline.discovery.mechanisms.time_step import integrations
from pipeline.discovery.selection.equivalence import Sets, alike_each
from pipeline.discovery.selection.forward_selection import ForwardSelection, forward_selection
from pipeline.discovery.selection.shorter import LEAST_REMAINDER
from pipeline.discovery.selection.unexplained import UNEXPLAINED_Z

ROUNDS = 3  # times that the noise is taken from the best model so far
#: Levels from the longest windows down to those of the race, and from these to those that tell where something acts.
SHORTER = 2
MOST_LEFT = 0.3  # of the gap; real logs leave 0.04 to 0.25 beside friction, unlisted laws 0.33 and more beside another
SAME_NOISE = 1.5  # ratio of variances below which it need not be taken again


@dataclass(frozen=True)
class MechanismSelection:
    """Which effects a log supports; as `Selection` of free bodies.

    Attributes:
        none: The calibrated model, without effects.
        singles: A model for each effect alone, the best first.
        tried: All models of several effects that were fitted.
        chosen: The model that wins, possibly without effects.
        alike: Sets of effects that cannot be told from one of the chosen model's.
        excess_z: What it leaves beyond the noise of the columns, as a z-score.
        unknown: Whether that is too much.
        short: The calibrated model on short windows, which tell where something acts.
        noise: What residuals counted as noise.
        untestable: Names of effects that could not act, or not be seen.
        stated_steps: Whether the log is explained by the time steps that the model states, and not by other ones.
        ruled_out: Names of effects that something beside the motion speaks against.
    """

    none: Candidate
    singles: tuple[Candidate, ...]
    tried: tuple[Candidate, ...]
    chosen: Candidate
    alike: Sets
    excess_z: float
    unknown: bool
    short: Candidate
    noise: Noise
    untestable: tuple[str, ...]
    stated_steps: bool = True
    ruled_out: tuple[str, ...] = ()

    @property
    def answer(self) -> Candidate:
        """The model behind the verdict: the chosen one, or the calibrated one where the effect is unknown."""
        return self.none if self.unknown else self.chosen


def select_mechanism(
    levels: Sequence[Problem],
    numbers: tuple[FreeNumber, ...],
    kinds: tuple[MechanismEffect, ...],
    progress: Callable[[str], None],
) -> MechanismSelection:
    """The selection for a log.

    Time steps that are small enough for the motion compete with those that the model states, where these predict
    something else.

    Args:
        levels: The log in windows of growing length, simulated as the model states.
        numbers: That the user lists as not known.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    model, stated = LawModel(numbers), np.array([n.stated for n in numbers])

    def searched(simulator: Simulator) -> MechanismSearch:
        return MechanismSearch(tuple(p.simulated_by(simulator) for p in levels), kinds, progress)

    as_stated = searched(levels[0].simulator)
    none = as_stated.climb(model, stated)
    near = none[_longest(none)].problem
    ways = integrations(near, model, stated, near.guessed)
    best: MechanismSelection | None = None
    for simulator in ways:
        search = as_stated if simulator is near.simulator else searched(simulator)
        base = none if search is as_stated else search.climb(model, stated)
        if best is not None and best.chosen.near_noise and not base[_longest(base)].near_noise:
            break
        found = replace(_select(search, base), stated_steps=simulator is ways[-1])
        best = found if best is None else min(best, found, key=_preference(best, found))
        if not best.chosen.effects and best.chosen.near_noise:
            break
    assert best is not None
    return best


def _preference(*found: MechanismSelection) -> Callable[[MechanismSelection], tuple[int, float]]:
    """The key that orders selections with different time steps, the best first: longest windows, then the score."""
    noise = min((f.noise for f in found), key=lambda n: n.variance)
    return lambda f: (len(f.chosen.problem.windows), f.chosen.rescored(noise).score)


def _select(search: MechanismSearch, none: Sequence[Candidate]) -> MechanismSelection:
    """The selection with one time step.

    Args:
        search: With all levels.
        none: The model without effects at each level that it follows.
    """
    race = max(_longest(none) - SHORTER, 0)
    search = replace(search, levels=search.levels[race:])
    climbs = search.climbs(none[race], MOST_FITTED)
    last = _longest(none[race:], *climbs)
    base, *fitted = (search.at(last, climb) for climb in (none[race:], *climbs))
    search = replace(search, levels=search.levels[: last + 1])
    best = min([base, *fitted], key=lambda c: c.fit.chi2.sum())
    noise = noise_of(best)
    for _ in range(ROUNDS):
        search = search.with_noise(noise, base)
        base, fitted = base.rescored(noise), [c.rescored(noise) for c in fitted]
        singles = best_of_each(fitted)
        showing = [c for c in singles if shows(c, base)]
        best = min([base, *showing], key=search.rank)
        if best.effects and best.score < base.score - CLAIM:
            found = _exchanged(search, forward_selection(search, base, best, showing))
            chosen, tried = found.chosen, found.tried
        else:
            chosen, tried = base, ()
        smallest = noise_of(min([chosen, *search.tried], key=lambda c: c.variance))
        if smallest.variance > noise.variance / SAME_NOISE:
            break
        noise = smallest
    z = excess_z(chosen, noise.information)
    names = {name for c in singles for name in c.effects}
    rivals = tried if len(chosen.effects) > 1 else singles
    return MechanismSelection(
        none=base,
        singles=tuple(singles),
        tried=tuple(tried),
        chosen=chosen,
        alike=alike_each(chosen, best_of_each(rivals), search.rank),
        excess_z=z,
        unknown=_is_unknown(base, chosen, z),
        short=none[max(race - SHORTER, 0)],
        noise=noise,
        untestable=tuple(k.name for k in search.kinds if k.name not in names and not _can_show(search.problem, k)),
    )


def _exchanged(search: MechanismSearch, found: ForwardSelection[Candidate]) -> ForwardSelection[Candidate]:
    """The selection after each of several effects competed again, now that the others are there."""
    chosen = found.chosen
    if len(chosen.effects) < 2:
        return found
    tried = (*found.tried, *(c for base in search.shorter(chosen) for c in search.longer(base)))
    return ForwardSelection(min((c for c in tried if len(c.effects) == len(chosen.effects)), key=search.rank), tried)


def _can_show(problem: Problem, kind: MechanismEffect) -> bool:
    """Whether there is a place at which an effect could act and be seen."""
    return any(may_act(kind, problem.mechanism, problem.log, place) for place in problem.places[kind.target])


def _longest(*climbs: Sequence[Candidate]) -> int:
    """The longest windows in which some model stays near the motion: where it is chaotic none would in longer ones."""
    return max((level for climb in climbs for level, c in enumerate(climb) if c.follows), default=0)


def _is_unknown(none: Candidate, chosen: Candidate, z: float) -> bool:
    """Whether a model leaves too much to be the answer: more than noise, and more than a part of the gap."""
    gap = measure_gap(none, chosen)
    if z <= UNEXPLAINED_Z or gap.after <= LEAST_REMAINDER * gap.noise_floor:
        return False
    return not chosen.effects or gap.left > MOST_LEFT
