"""Effects that the measurements cannot tell apart, and the experiment that would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pipeline.scene.effects.registry import effect_kinds

if TYPE_CHECKING:
    from pipeline.discrepancy.estimate import Estimate
    from pipeline.discrepancy.problem import Problem
    from pipeline.discrepancy.select import Selection, Selector

MOVED = 4.0  # standard errors by which a calibrated number must leave what was stated to be worth a word
SAME_LAW = {"damping": "restitution", "rolling_friction": "rolling_resistance"}
"""Scene parameters that, left free, are an effect by another name."""


def alike_sets(
    found: Selection, problem: Problem, calibrated: Mapping[str, Estimate], selector: Selector
) -> tuple[tuple[str, ...], ...]:
    """Sets of names of which any one explains the measurements as well as the others."""
    if found.unknown or found.chosen.effects:
        return found.alike
    out = []
    for key, estimate in calibrated.items():
        name, _, parameter = key.partition(".")
        effect = SAME_LAW.get(parameter)
        if effect is None or not isinstance(estimate.stderr, float) or not isinstance(estimate.value, float):
            continue
        stated = next(getattr(o, parameter) for o in problem.known.scene.objects if o.name == name)
        if abs(estimate.value - stated) > MOVED * max(estimate.stderr, 1e-9) and (effect,) not in out:
            out.append((effect,))
    return tuple(out)


def experiment(names: Sequence[str], equivalent: Sequence[Sequence[str]]) -> str:
    """What to do next: what would tell equivalent effects apart, or what would show the doubt to be wrong."""
    kinds = effect_kinds()
    told = [f"{n}: {kinds[n].experiment}" for group in equivalent for n in group if n in kinds]
    if told:
        return "; ".join(dict.fromkeys(told))
    if list(names) == ["unknown"]:
        return "repeat with other speeds, masses and places, and see with which of them the residual force changes"
    if names:
        return "; ".join(kinds[n].experiment for n in names)
    return "none needed: the calibrated model explains the measurements"
