"""A verdict against the truth: was it right, and how many of them were, with Wilson's intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from pipeline.hidden.experiment import BOUNCING, EVERY, FLYING

PERIODS = {("anisotropic_friction", "angle"): np.pi}  # of parameters that turn back to where they were
LARGEST_SET = 3  # an equivalence set of more names is no answer


SCALES: dict[str, Callable[[Mapping[str, Any]], bool]] = {
    "buoyancy": lambda e: True,
    "gravity_error": lambda e: bool(e["gravity"] < 9.81),
    "length_scale": lambda e: bool(e["ratio"] < 1),
    "clock_rate": lambda e: bool(e["ratio"] > 1),
}
"""Effects that only scale the gravity that a free flight shows (gravity x length scale / clock rate squared), with
whether one of them makes it weaker: buoyancy can do nothing else."""
IN_THE_AIR = (*FLYING, BOUNCING)
ONE_BODY = frozenset(EVERY) - {"pair", "carom"}


def equals_of(effect: Mapping[str, Any], truth: Mapping[str, Any]) -> frozenset[str]:
    """The effects, at most three, that are the same law as a hidden one in that experiment: struck off the list, it may
    be named so. truth: of the hidden world."""
    name, scenario = effect["name"], truth["scenario"]
    if name in SCALES and scenario in IN_THE_AIR:
        return frozenset(n for n in SCALES if n != name and (n != "buoyancy" or SCALES[name](effect)))
    if name == "adhesion":  # presses as a larger weight does
        return frozenset(SCALES) - {"buoyancy"}
    if name == "tilted_gravity" and scenario in ONE_BODY:  # a far attractor pulls evenly, but all masses alike
        return frozenset({"hidden_attractor"})
    if name == "air_drag":  # wind of no speed
        return frozenset({"wind"})
    if name == "viscous_friction" and scenario == "puck":  # never in the air, where only drag would act
        return frozenset({"linear_drag"})
    if name == "hidden_obstacle" and truth["clips"] == 1:  # a blow is sought in all clips
        return frozenset({"impulse"})
    return frozenset()


@dataclass(frozen=True)
class Judgement:
    """right: the hidden effects were named, by the verdict or by a small set of equivalents; false: something was
    claimed that is not there; some: of several effects one at least was named. label: what the confusion matrix
    counts it as. errors: relative error of each parameter; covered: the share of its components
    whose 95 % interval holds the truth."""

    right: bool
    false: bool
    some: bool
    truth: str
    label: str
    errors: Mapping[str, float]
    covered: Mapping[str, float]


def judge(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> Judgement:
    """verdict: of report.json; truth: of a hidden world (`pipeline.hidden.world`). Of an effect struck off the list,
    `unknown` is right, and so are its `equals_of`."""
    hidden = {e["name"] for e in truth["effects"]}
    named = [n for n in verdict["effects"] if n != "unknown"]
    unknown = "unknown" in verdict["effects"]
    sets = [set(s) for s in verdict["equivalent"] if len(s) <= LARGEST_SET]
    listed = truth.get("unlisted") is None and not truth.get("struck")
    name = "+".join(sorted(hidden)) if hidden and listed else "none" if listed else "unlisted"
    answer = "unknown" if unknown else "+".join(sorted(named)) or "none"
    struck = [e for e in truth["effects"] if e["name"] == truth.get("struck")]
    equals = frozenset().union(*(equals_of(e, truth) for e in struck))
    if not listed and named and set(named) <= equals:
        return Judgement(True, False, True, name, name, {}, {})
    if not listed:
        return Judgement(unknown, bool(named), unknown, name, name if unknown else answer, {}, {})
    if not hidden:
        return Judgement(not named and not unknown, bool(named), True, name, answer, {}, {})
    meant = [{n}.union(*(s for s in sets if n in s)) for n in named]  # by each name: itself or its equals
    alike = len(named) == len(hidden) and any(
        all(h in m for h, m in zip(order, meant, strict=True)) for order in permutations(hidden)
    )
    right = not unknown and alike
    label = name if right else answer
    same_law = set(named) == hidden and truth.get("wrong") is None  # else its numbers mean something else
    errors, covered = _parameters(verdict, truth) if same_law else ({}, {})
    return Judgement(right, bool(set(named) - hidden) and not right, any(hidden & m for m in meant), name, label,
                     errors, covered)  # fmt: skip


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
            if (effect["name"], key) in PERIODS:
                period = PERIODS[effect["name"], key]
                off = (off + period / 2) % period - period / 2
            errors[f"{effect['name']}.{key}"] = float(np.linalg.norm(off)) / size
            covered[f"{effect['name']}.{key}"] = float(np.mean(np.abs(off) <= 1.96 * spread))
    return errors, covered


def wilson(hits: int, count: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    if count == 0:
        return 0.0, 1.0
    p, q = hits / count, z * z / count
    centre, half = p + q / 2, z * np.sqrt(p * (1 - p) / count + q / 4 / count)
    return float((centre - half) / (1 + q)), float((centre + half) / (1 + q))


def macro_f1(judged: Sequence[Judgement]) -> float:
    """Mean over the true names of the harmonic mean of precision and recall."""
    names = sorted({j.truth for j in judged})
    scores = []
    for name in names:
        hits = sum(j.truth == name and j.right for j in judged)
        told = sum((j.label == name) for j in judged)
        there = sum(j.truth == name for j in judged)
        scores.append(2 * hits / max(told + there, 1))
    return float(np.mean(scores)) if scores else 0.0


def confusion(judged: Sequence[Judgement]) -> tuple[list[str], list[str], np.ndarray]:
    """Names of the rows (truth) and columns (answer), and how often each pair came."""
    rows = sorted({j.truth for j in judged})
    columns = [*rows, *sorted({j.label for j in judged} - set(rows))]
    counts = np.zeros((len(rows), len(columns)), int)
    for j in judged:
        counts[rows.index(j.truth), columns.index(j.label)] += 1
    return rows, columns, counts
