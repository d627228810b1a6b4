"""Effects that are established although something remains that no listed effect explains.

Beside such a remainder differences of scores mean little, since residuals are systematic: with enough samples any
effect that bends the paths a bit wins. So an effect is asked for its substance: on clips that were not fitted it has to
remove at least half of what the model without it leaves. A law with more numbers, those of each arc included, bends to
anything; it has to leave at most a quarter of what one with fewer leaves. Where no effect is named so, one may be that
removes half where it acts (`touched.py`): what a sliding body leaves must not hide an effect on its flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import Progress, extend, without_one
from pipeline.discovery.selection.arc_search import MOST_FITTED_MORE
from pipeline.discovery.selection.comparison import other_evidence
from pipeline.discovery.selection.equivalence import Sets
from pipeline.discovery.selection.forecast import forecast_error
from pipeline.discovery.selection.forward_selection import LEADERS, MOST_EFFECTS
from pipeline.discovery.selection.gap import body_gap, measure_gap
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.selection.stability import is_stable
from pipeline.discovery.selection.touched import Touched, touched
from pipeline.discovery.selection.unexplained import UNEXPLAINED_Z, excess
from pipeline.discovery.tracks.problem import recorded_alone
from pipeline.scene.effects.kind import EffectKind

MOST_LEFT = 0.5  # of the gap beyond noise that the model without an effect leaves, root mean square
MOST_LEFT_BY_MORE = 0.25  # of what a law with fewer numbers leaves
ALIKE_LEFT = 1.25  # effects that leave up to so many times as much are not told apart
#: Beside a remainder, an effect is named if at most so many, it included, leave up to so many times as much: what more
#: of them explain nearly as well is part of the remainder.
MOST_NEAR, NEAR_LEFT = 3, 1.5
#: By how much chi squared of the held-out clips must fall with each effect. A true difference d of the predictions
#: changes chi squared by d² with a standard deviation of 2 d, so that a fall by 4 equals its own uncertainty.
HELD_OUT_GAIN = 4.0
MOST_HARM = 1.5  # largest ratio of a body's gap with an effect to its gap without it


def with_established(found: Selection, kinds: Sequence[EffectKind], progress: Progress) -> Selection | None:
    """The selection of the effects that are established, with what cannot be told from them; None where none is.

    Effects are added one by one, the simplest first of those that count. Where none counts alone, two may; where no two
    do, one may where it acts.

    Args:
        found: A selection that leaves more than noise, with clips that were held out.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    if not found.problem.held_out:
        return None
    kinds = [kind for kind in kinds if kind.discovery.fit_hits is None and kind.bounce_ratio is None]
    fitted = {c.name for c in found.singles}
    more = extend(found.calibration, found.none, [k for k in kinds if k.name not in fitted], progress)
    found = replace(found, singles=tuple(sorted((*found.singles, *more), key=lambda c: c.score)))
    singles = [c for c in found.singles if c.hits is None and c.restitution is None and other_evidence(c) >= 0]
    longer = singles
    chosen, tried = found.none, [*found.tried]
    alike: Sets = ()
    while True:
        best = _simplest([c for c in longer if _counts(found, c, chosen)], found)
        if best is None and not chosen.effects and longer and len(longer[0].effects) == 1:
            leaders = sorted(longer, key=lambda c: left_of_gap(found, c))[:LEADERS]
            longer = [c for base in leaders for c in extend(found.calibration, base, kinds, progress, MOST_FITTED_MORE)]
            tried += longer
            continue
        where = None
        if best is None and not chosen.effects:
            longer = singles
            best = _simplest([c for c in longer if _counts_where_it_acts(found, c)], found)
            where = None if best is None else _touched(found, best)
        if best is None or (chosen.effects and _is_part_of_remainder(found, best, longer)):
            break
        if chosen.effects and not is_stable(found.calibration, best):
            break
        alike = _still_alike(found, alike, best, kinds, progress) + _alike(found, best, longer, where)
        chosen = best
        if len(chosen.effects) == MOST_EFFECTS or excess(found.calibration, chosen)[0] <= UNEXPLAINED_Z:
            break
        longer = extend(found.calibration, chosen, kinds, progress, MOST_FITTED_MORE)
        tried += longer
    if _is_simpler(found, found.chosen, chosen):
        chosen, alike = found.chosen, found.alike
    if not chosen.effects:
        return None
    z, share = excess(found.calibration, chosen)
    return replace(
        found,
        chosen=chosen,
        alike=alike,
        tried=tuple(tried),
        unknown=False,
        untestable=tuple(name for name in found.untestable if name not in chosen.effects),
        excess_z=z,
        excess_share=share,
    )


def models_without(found: Selection) -> dict[str, Candidate]:
    """For each effect of the chosen model, the fitted model without it, where there is one."""
    by_effects = {frozenset(c.effects): c for c in (*found.tried, *found.singles, found.none)}
    rest = {name: frozenset(found.chosen.effects) - {name} for name in found.chosen.effects}
    return {name: by_effects[names] for name, names in rest.items() if names in by_effects}


def left_of_gap(found: Selection, model: Candidate) -> float:
    """What a model leaves of the first gap beyond noise, on held-out clips."""
    return measure_gap(found.measured, found.baseline, model).left


def halves_gap(found: Selection, model: Candidate, shorter: Candidate) -> bool:
    """Whether a model leaves less than half of what a shorter one leaves; never where that leaves nothing but noise."""
    return left_of_gap(found, model) < MOST_LEFT * left_of_gap(found, shorter)


def _counts(found: Selection, model: Candidate, base: Candidate) -> bool:
    """Whether a model leaves enough less on the held-out clips than without any one of its effects, and forecasts
    better. base: the model that it extends by the last of its effects."""
    without = _without_one(found, model, base)
    return len(without) >= min(len(model.effects), 2) and all(
        halves_gap(found, model, shorter) and _shows(model, shorter) and not _harms_a_body(found, model, shorter)
        for shorter in without
    )


def _harms_a_body(found: Selection, model: Candidate, shorter: Candidate) -> bool:
    """Whether a model explains one of the bodies that were recorded one by one much worse than a shorter one.

    What acts on all of them, as a wrong ruler does, has to suit each: heavy balls bound it where light ones would not.
    """
    bodies = recorded_alone(found.problem)
    if len(bodies) < 2:
        return False
    floor = measure_gap(found.measured, found.baseline, model).noise_floor
    return any(body_gap(model, body) > MOST_HARM * max(body_gap(shorter, body), floor) for body in bodies)


def _counts_where_it_acts(found: Selection, single: Candidate) -> bool:
    """Whether an effect leaves enough less in the coordinates that it changes."""
    where = _touched(found, single)
    return where.left(single) <= MOST_LEFT * where.left(found.none) and _shows(single, found.none)


def _touched(found: Selection, single: Candidate) -> Touched:
    return touched(found.none, single, measure_gap(found.measured, found.baseline, single).noise_floor)


def _shows(model: Candidate, shorter: Candidate) -> bool:
    """Whether a model predicts and forecasts held-out clips better than a shorter one."""
    gain = shorter.held_out - model.held_out
    return gain > HELD_OUT_GAIN and forecast_error(model) < forecast_error(shorter)


def _without_one(found: Selection, model: Candidate, base: Candidate) -> list[Candidate]:
    """The model without each one of its effects, where that was fitted. base: without the last one."""
    if len(model.effects) == 1:
        return [found.none]
    if len(model.effects) == 2:
        return [c for c in found.singles if c.name in model.effects]
    return [base, *(c for c in without_one(found.calibration, model) if model.effects[-1] in c.effects)]


def _simplest(models: Sequence[Candidate], found: Selection) -> Candidate | None:
    """The model with the fewest numbers, unless one with more leaves at most a quarter as much."""
    best: Candidate | None = None
    for c in sorted(models, key=lambda c: (c.parameters, left_of_gap(found, c))):
        if best is None or left_of_gap(found, c) <= MOST_LEFT_BY_MORE * left_of_gap(found, best):
            best = c
    return best


def _is_simpler(found: Selection, pair: Candidate, other: Candidate) -> bool:
    """Whether two effects that win by their score are both established, and simpler than what was added one by one.

    A law with many numbers may remove enough alone, and leave too little for any second effect to count.
    """
    if len(pair.effects) != 2 or set(pair.effects) == set(other.effects) or not _counts(found, pair, found.none):
        return False
    as_simple = [c for c in found.tried if len(c.effects) == 2 and c.parameters <= pair.parameters]
    best = _simplest([c for c in (other, pair) if c.effects], found)
    return best is pair and not _is_part_of_remainder(found, pair, as_simple)


def _is_part_of_remainder(found: Selection, longer: Candidate, rivals: Sequence[Candidate]) -> bool:
    """Whether a model leaves more than noise, and many effects, of whatever size, explain nearly what its last does.

    Where a force is missing that no effect makes, any law that bends the paths explains a part of it.
    """
    most, others = NEAR_LEFT * left_of_gap(found, longer), set(longer.effects[:-1])
    names = {n for c in rivals if left_of_gap(found, c) <= most for n in set(c.effects) - others}
    return len(names) > MOST_NEAR and excess(found.calibration, longer)[0] > UNEXPLAINED_Z


def _alike(found: Selection, chosen: Candidate, rivals: Sequence[Candidate], where: Touched | None) -> Sets:
    """What could replace one of the effects as well, with no more numbers. where: in these coordinates, too."""
    most = ALIKE_LEFT * left_of_gap(found, chosen)
    near = [c for c in rivals if c.parameters <= chosen.parameters and left_of_gap(found, c) <= most]
    if where is not None:
        near = [c for c in near if where.left(c) <= ALIKE_LEFT * where.left(chosen)]
    out = []
    for name in chosen.effects:
        others = set(chosen.effects) - {name}
        names = [n for c in near for n in c.effects if set(c.effects) - {n} == others and n not in others]
        out.append(tuple(dict.fromkeys((name, *names))))
    return tuple(names for names in out if len(names) > 1)


def _still_alike(
    found: Selection, alike: Sets, longer: Candidate, kinds: Sequence[EffectKind], progress: Progress
) -> Sets:
    """Of the sets that held without the last effect of a model, those that hold with it.

    Args:
        found: The selection.
        alike: Sets whose first name is in the model.
        longer: The model.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
    """
    last = [kind for kind in kinds if kind.name == longer.effects[-1]]
    singles = {c.name: c for c in found.singles}
    out = []
    for first, *others in alike:
        names = [first]
        for other in others:
            base = singles.get(other) if len(longer.effects) == 2 else None
            rivals = [] if base is None else extend(found.calibration, base, last, progress)
            names += [other for c in rivals if left_of_gap(found, c) <= ALIKE_LEFT * left_of_gap(found, longer)]
        out.append(tuple(names))
    return tuple(names for names in out if len(names) > 1)
