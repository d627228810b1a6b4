"""Effects that the measurements cannot tell apart, and the experiment that would."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from pipeline.discovery.fitting.calibration import Calibration
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import calibrated
from pipeline.discovery.selection.comparison import ALIKE, Scored, with_other_evidence
from pipeline.discovery.selection.selection import Selection
from pipeline.scene.effects.registry import effect_kinds, kind_of_scene_parameter

MOVED = 4.0  # standard errors by which a calibrated number must differ from what was stated to be mentioned
ABSORBED_SHARE = 1 / 3  # of what an effect that scales gravity explains: a law that explains this may be the cause
Sets = tuple[tuple[str, ...], ...]
Model = TypeVar("Model", bound=Scored)


def alike_single(chosen: Candidate, singles: Sequence[Candidate]) -> Sets:
    """The set of single effects that explain the measurements as well as the chosen one."""
    if not chosen.effects:
        return ()
    names = [name for c in near(chosen, singles, with_other_evidence) for name in c.effects]
    kinds = effect_kinds()
    hit_once = any(c.hits is not None and c.hits.count == 1 for c in singles)
    if kinds[chosen.name].is_single_blow and hit_once:  # one hit may be any blow
        blows = [c.name for c in singles if kinds[c.name].is_single_blow]
        names = list(dict.fromkeys([chosen.name, *names, *blows]))
    return (tuple(names),) if len(names) > 1 else ()


def near(chosen: Model, others: Sequence[Model], rank: Callable[[Model], float]) -> list[Model]:
    """Of other models with as many effects those that explain the measurements as well as the chosen one."""
    return [c for c in others if len(c.effects) == len(chosen.effects) and rank(c) < chosen.score + ALIKE]


def alike_each(chosen: Model, tried: Sequence[Model], rank: Callable[[Model], float]) -> Sets:
    """For each effect of a model: the effect with those that could replace it as well."""
    as_good = near(chosen, tried, rank)
    groups = []
    for name in chosen.effects:
        others = set(chosen.effects) - {name}
        names = [n for c in as_good for n in c.effects if others == set(c.effects) - {n} and n not in others]
        groups.append(tuple(dict.fromkeys([name, *names])))
    return tuple(group for group in groups if len(group) > 1)


def absorbed_laws(calibration: Calibration, chosen: Candidate, singles: Sequence[Candidate]) -> tuple[str, ...]:
    """Laws that the chosen effect may have absorbed, if it only scales gravity.

    They explain at least `ABSORBED_SHARE` of what it explains, and the rest is within the residuals of both.
    """
    kinds = effect_kinds()
    if len(chosen.effects) != 1 or kinds[chosen.name].discovery.gravity_scale is None:
        return ()
    least = calibration.none.score - ABSORBED_SHARE * (calibration.none.score - chosen.score)
    return tuple(c.name for c in singles if c.score < least and kinds[c.name].discovery.gravity_scale is None)


def equivalent_sets(found: Selection) -> Sets:
    """Sets of names of which any one explains the measurements as well as the others.

    Where nothing is missing: effects that a calibrated number stands for, if it differs much from what was stated.
    """
    if found.unknown or found.chosen.effects:
        return found.alike
    out: list[tuple[str, ...]] = []
    for key, estimate in calibrated(found.calibration, found.none).items():
        name, _, parameter = key.partition(".")
        kind = kind_of_scene_parameter(parameter)
        if kind is None or not isinstance(estimate.stderr, float) or not isinstance(estimate.value, float):
            continue
        stated = next(getattr(o, parameter) for o in found.problem.known.scene.objects if o.name == name)
        if abs(estimate.value - stated) > MOVED * max(estimate.stderr, 1e-9) and (kind.name,) not in out:
            out.append((kind.name,))
    return tuple(out)


def next_experiment(
    names: Sequence[str], equivalent: Sequence[Sequence[str]], kinds: Mapping[str, Any] | None = None
) -> str:
    """The experiment that would tell equivalent effects apart, or test a verdict.

    kinds: the effects by name; None: those of free bodies.
    """
    kinds = effect_kinds() if kinds is None else kinds
    several = [f"{n}: {kinds[n].experiment}" for group in equivalent for n in group if n in kinds]
    if several:
        return "; ".join(dict.fromkeys(several))
    if list(names) == ["unknown"]:
        return "repeat with other speeds, masses and places, and see with which of them the residual force changes"
    if names:
        return "; ".join(kinds[n].experiment for n in names)
    return "none needed: the calibrated model explains the measurements"
