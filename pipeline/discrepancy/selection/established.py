"""Effects that are established although something remains that no listed effect explains.

Beside such a remainder differences of scores mean little, since residuals are systematic: with enough samples any
effect that bends the paths a bit wins. So an effect is asked for its substance: on clips that were not fitted it has to
remove at least half of what the model without it leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from pipeline.discrepancy.fitting.candidate import Candidate
from pipeline.discrepancy.selection.gap import measure_gap
from pipeline.discrepancy.selection.selection import Selection

MOST_LEFT = 0.5  # of the gap beyond noise that the model without an effect has, root mean square
ALIKE_LEFT = 1.25  # effects alone that leave up to so many times as much as the best one are not told from it
#: By how much chi squared of the held-out clips must fall with each effect. A true difference d of the predictions
#: changes chi squared by d² with a standard deviation of 2 d, so that a fall by 4 equals its own uncertainty.
HELD_OUT_GAIN = 4.0


def with_established(found: Selection) -> Selection | None:
    """The selection of the effects that are established, with what cannot be told from them; None where none is.

    Args:
        found: A selection beside a remainder (`Selection.first`), with clips that were held out.
    """
    if found.unknown or not found.problem.held_out:
        return None
    models = {frozenset(c.effects): c for c in (found.none, *found.singles, *found.tried, found.chosen)}
    left = {names: _left(found, c) for names, c in models.items()}
    good = [names for names in models if names and _each_counts(names, models, left)]
    if not good:
        return None
    most = max(map(len, good))
    best = min((names for names in good if len(names) == most), key=left.__getitem__)
    near = [names for names in good if len(names) == most and left[names] <= ALIKE_LEFT * left[best]]
    simplest = min(near, key=lambda names: (models[names].fit.model.size, left[names]))
    chosen = models[simplest]
    sets = []
    for name in chosen.effects:
        others = simplest - {name}
        rivals = [next(iter(names - others)) for names in near if others < names and names != simplest]
        sets.append((name, *rivals))
    return replace(found, chosen=chosen, alike=tuple(s for s in sets if len(s) > 1))


def models_without(found: Selection) -> dict[str, Candidate]:
    """For each effect of the chosen model, the fitted model without it, where there is one."""
    models = {frozenset(c.effects): c for c in (*found.tried, *found.singles, found.none)}
    rest = {name: frozenset(found.chosen.effects) - {name} for name in found.chosen.effects}
    return {name: models[names] for name, names in rest.items() if names in models}


def _left(found: Selection, model: Candidate) -> float:
    """What a model leaves of the first gap beyond the noise as measured, root mean square."""
    return measure_gap(found.measured, found.baseline, model).left


def _each_counts(
    names: frozenset[str], models: Mapping[frozenset[str], Candidate], left: Mapping[frozenset[str], float]
) -> bool:
    """Whether each effect of a model lowers the gap of the held-out clips by enough."""
    for name in names:
        rest = names - {name}
        if rest not in models or left[names] > MOST_LEFT * left[rest]:
            return False
        if models[rest].held_out - models[names].held_out <= HELD_OUT_GAIN:
            return False
    return True
