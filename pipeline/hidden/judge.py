"""A verdict judged by the truth, and summaries of many of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np

from pipeline.hidden.scenario import experiment_of
from pipeline.scene.effects.kind import Parameter
from pipeline.scene.effects.registry import effect_kinds

LARGEST_SET = 3  # an equivalence set of more names is no answer


def equals_of(effect: Mapping[str, Any], truth: Mapping[str, Any]) -> frozenset[str]:
    """The effects, at most three, that are the same law as a hidden one in its experiment.

    If the hidden effect is struck off the list, it may be named so. effect: one of truth["effects"]; truth: of the
    hidden world.
    """
    kinds, experiment = effect_kinds(), experiment_of(truth["scenario"], truth["clips"])
    rules = kinds[effect["name"]].discovery
    names = frozenset() if rules.equals is None else rules.equals(effect, experiment)
    if rules.gravity_scale is None or not experiment.in_the_air:
        return names
    weaker = rules.gravity_scale.weakens(effect)
    scales = {n: k.discovery.gravity_scale for n, k in kinds.items() if n != effect["name"]}
    return names | {n for n, scale in scales.items() if scale is not None and (weaker or not scale.only_weakens)}


@dataclass(frozen=True)
class Judgement:
    """A judged verdict.

    Attributes:
        right: The hidden effects were named, by the verdict or by a small set of equivalents.
        false: Something was claimed that is not there.
        some: Of several hidden effects at least one was named.
        truth: The hidden effects, as one name.
        label: The column of the confusion matrix.
        errors: Relative error of each parameter.
        covered: Share of each parameter's components whose 95 % interval holds the truth.
    """

    right: bool
    false: bool
    some: bool
    truth: str
    label: str
    errors: Mapping[str, float] = field(default_factory=dict)
    covered: Mapping[str, float] = field(default_factory=dict)


def judge(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> Judgement:
    """Judge a verdict of report.json by the truth of a hidden world (`pipeline.hidden.world`).

    If the hidden effect was struck off the list, `unknown` is right, and so are its `equals_of`. An effect named where
    an unlisted law acts is right only with a remainder: the hidden effect beside it, one of the law's kind, or both.
    """
    hidden = {e["name"] for e in truth["effects"]}
    named = [n for n in verdict["effects"] if n != "unknown"]
    unknown = "unknown" in verdict["effects"]
    sets = [set(s) for s in verdict["equivalent"] if len(s) <= LARGEST_SET]
    beside = truth.get("unlisted") is not None and bool(hidden)
    listed = (truth.get("unlisted") is None or beside) and not truth.get("struck")
    name = "+".join(sorted(hidden)) if hidden and listed else "none" if listed else "unlisted"
    answer = "unknown" if unknown else "+".join(sorted(named)) or "none"
    struck = [e for e in truth["effects"] if e["name"] == truth.get("struck")]
    equals = frozenset().union(*(equals_of(e, truth) for e in struck))
    if not listed and named and set(named) <= equals:
        return Judgement(right=True, false=False, some=True, truth=name, label=name)
    if truth.get("unlisted") is not None and not hidden and named and verdict.get("remainder") is not None:
        kin = all(_resembles(n, truth["unlisted"]) for n in named)
        return Judgement(right=kin, false=not kin, some=kin, truth=name, label=name if kin else answer)
    if not listed:
        label = name if unknown else answer
        return Judgement(right=unknown, false=bool(named), some=unknown, truth=name, label=label)
    if not hidden:
        return Judgement(right=not named and not unknown, false=bool(named), some=True, truth=name, label=answer)
    meant = [{n}.union(*(s for s in sets if n in s)) for n in named]  # each name stands for its equals, too
    if beside:
        meant = [m for n, m in zip(named, meant, strict=True) if m & hidden or not _resembles(n, truth["unlisted"])]
    alike = len(meant) == len(hidden) and any(
        all(h in m for h, m in zip(order, meant, strict=True)) for order in permutations(hidden)
    )
    right = not unknown and alike and not (beside and verdict.get("remainder") is None)
    # else its numbers mean something else
    same_law = set(named) == hidden and truth.get("wrong") is None and not beside
    errors, covered = _parameters(verdict, truth) if same_law else ({}, {})
    return Judgement(
        right=right,
        false=bool(set(named) - hidden) and not alike,
        some=any(hidden & m for m in meant),
        truth=name,
        label=name if right else answer,
        errors=errors,
        covered=covered,
    )


def _resembles(name: str, unlisted: str) -> bool:
    hiding = effect_kinds()[name].hiding
    return hiding is not None and unlisted in hiding.resembles


def _parameters(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, float]]:
    errors: dict[str, float] = {}
    covered: dict[str, float] = {}
    for effect in truth["effects"]:
        for key, value in effect.items():
            if key == "name":
                continue
            found = verdict["parameters"].get(key if len(truth["effects"]) == 1 else f"{effect['name']}.{key}")
            if found is None or found["stderr"] is None:
                continue
            true, own = np.atleast_1d(np.array(value, float)), np.atleast_1d(np.array(found["value"], float))
            spread = np.atleast_1d(np.array(found["stderr"], float))
            size = max(float(np.linalg.norm(true)), 1e-12)
            off = own - true
            period = _parameter(effect["name"], key).period
            if period is not None:
                off = (off + period / 2) % period - period / 2
            errors[f"{effect['name']}.{key}"] = float(np.linalg.norm(off)) / size
            covered[f"{effect['name']}.{key}"] = float(np.mean(np.abs(off) <= 1.96 * spread))
    return errors, covered


def _parameter(effect: str, name: str) -> Parameter:
    return next(p for p in effect_kinds()[effect].parameters if p.name == name)


def macro_f1(judged: Sequence[Judgement]) -> float:
    """Mean over the true names of the harmonic mean of precision and recall."""
    names = sorted({j.truth for j in judged})
    scores = []
    for name in names:
        hits = sum(j.truth == name and j.right for j in judged)
        labelled = sum(j.label == name for j in judged)
        there = sum(j.truth == name for j in judged)
        scores.append(2 * hits / max(labelled + there, 1))
    return float(np.mean(scores)) if scores else 0.0


def confusion(judged: Sequence[Judgement]) -> tuple[list[str], list[str], np.ndarray]:
    """Names of the rows (truth) and columns (answer), and the number of each pair."""
    rows = sorted({j.truth for j in judged})
    columns = [*rows, *sorted({j.label for j in judged} - set(rows))]
    counts = np.zeros((len(rows), len(columns)), int)
    for j in judged:
        counts[rows.index(j.truth), columns.index(j.label)] += 1
    return rows, columns, counts
