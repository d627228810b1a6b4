"""What the named effects leave unexplained: how much, where, and what it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.candidate import residuals_m
from pipeline.discovery.report.formula import residual_formula
from pipeline.discovery.report.localisation import stretches
from pipeline.discovery.selection.confidence import leaves_more
from pipeline.discovery.selection.equivalence import next_experiment
from pipeline.discovery.selection.gap import Gap
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.tracks.arc import Arc

NOTABLE_Z = 3.0  # of an arc whose residuals exceed the noise
LEAST_STRETCHES = 0.1  # share of the notable stretches that a regime or an object has to have
MOST_CANDIDATES = 3


@dataclass(frozen=True)
class Remainder:
    """What remains of the gap with the named effects in the model.

    Attributes:
        share: Of the first gap beyond noise, root mean square.
        noise_floors: Size of the gap that remains, in noise floors.
        regimes: In which it is.
        objects: Names of the objects that show it.
        form: The residual force as a formula.
        candidates: Listed effects that could make it: those that lower the score beside the named ones.
        experiment: What would tell.
    """

    share: float
    noise_floors: float
    regimes: tuple[str, ...]
    objects: tuple[str, ...]
    form: str
    candidates: tuple[str, ...]
    experiment: str


def remainder_of(found: Selection, gap: Gap) -> Remainder | None:
    """What a selection leaves unexplained; None where its model explains the measurements to the noise."""
    if not leaves_more(found):
        return None
    loud = _loud_arcs(found)
    notable = [
        s
        for s in stretches(found.answer)
        if any(a.clip == s.clip and a.object == s.object and a.time[0] <= s.start <= a.time[-1] for a in loud)
    ]
    least = LEAST_STRETCHES * len(notable)
    regimes = [str(s.regime) for s in notable]
    objects = [found.problem.known.scene.objects[s.object].name for s in notable]
    candidates = _candidates(found)
    return Remainder(
        share=gap.left,
        noise_floors=gap.after / gap.noise_floor if gap.noise_floor else 0.0,
        regimes=tuple(r for r in dict.fromkeys(regimes) if regimes.count(r) >= least),
        objects=tuple(o for o in dict.fromkeys(objects) if objects.count(o) >= least),
        form=residual_formula(found.answer),
        candidates=candidates,
        experiment=next_experiment(candidates or ("unknown",), ()),
    )


def _loud_arcs(found: Selection) -> list[Arc]:
    """The arcs whose residuals exceed the noise."""
    problem, out = found.answer.problem, []
    share, filtered = found.measured.floor.information, found.measured.floor.smoothing.information
    for stack, rows in zip(problem.stacks, residuals_m(problem, found.answer), strict=True):
        count = np.maximum(stack.free_rows(filtered) * filtered, 1)
        chi2 = (rows**2).sum((1, 2)) / found.measured.sigma**2 * share
        z = (chi2 - count) / np.sqrt(2 * count)
        out += [problem.arcs[i] for i in stack.index[z > NOTABLE_Z]]
    return out


def _candidates(found: Selection) -> tuple[str, ...]:
    """Effects that lower the score of the answer, the best first."""
    answer, named = found.answer, set(found.answer.effects)
    models = found.tried if named else found.singles
    longer = [c for c in models if named < set(c.effects) and len(c.effects) == len(named) + 1]
    better = sorted((c for c in longer if c.score < answer.score), key=lambda c: c.score)
    return tuple(dict.fromkeys(n for c in better for n in c.effects if n not in named))[:MOST_CANDIDATES]
