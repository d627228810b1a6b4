"""Whether effects are established although something remains that no listed effect explains."""

from __future__ import annotations

from pipeline.discrepancy.fitting.candidate import Candidate
from pipeline.discrepancy.selection.gap import measure_gap
from pipeline.discrepancy.selection.selection import Selection

MOST_LEFT = 0.5  # of the gap beyond noise on clips that were not fitted, root mean square
#: By how much chi squared of the held-out clips must fall with each effect. A true difference d of the predictions
#: changes chi squared by d² with a standard deviation of 2 d, so that a fall by 4 equals its own uncertainty.
HELD_OUT_GAIN = 4.0


def is_established(found: Selection) -> bool:
    """Whether the effects of a selection remove a substantial and significant share of the gap.

    Both are asked of clips that were not fitted; where there are none, the effects are not established.
    """
    chosen = found.chosen
    if found.unknown or not chosen.effects or not found.problem.held_out:
        return False
    if any(without.held_out - chosen.held_out <= HELD_OUT_GAIN for without in models_without(found).values()):
        return False
    gap = measure_gap(found.measured, found.baseline, chosen)
    return gap.left <= MOST_LEFT


def models_without(found: Selection) -> dict[str, Candidate]:
    """For each effect of the chosen model, the fitted model without it, where there is one."""
    chosen = found.chosen
    models = {frozenset(c.effects): c for c in (*found.tried, *found.singles, found.none)}
    rest = {name: frozenset(chosen.effects) - {name} for name in chosen.effects}
    return {name: models[names] for name, names in rest.items() if names in models}
