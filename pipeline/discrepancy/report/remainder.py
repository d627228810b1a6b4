"""What the named effects leave unexplained: how much, where, and what it may be."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.discrepancy.report.formula import residual_formula
from pipeline.discrepancy.report.localisation import stretches
from pipeline.discrepancy.selection.equivalence import next_experiment
from pipeline.discrepancy.selection.gap import Gap
from pipeline.discrepancy.selection.selection import Selection

NOTABLE_Z = 3.0  # of a stretch that counts
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
    if not found.remains and not found.unknown:
        return None
    notable = [s for s in stretches(found.answer) if s.z > NOTABLE_Z]
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


def _candidates(found: Selection) -> tuple[str, ...]:
    """Effects that lower the score of the answer, the best first."""
    answer, named = found.answer, set(found.answer.effects)
    models = found.tried if named else found.singles
    longer = [c for c in models if named < set(c.effects) and len(c.effects) == len(named) + 1]
    better = sorted((c for c in longer if c.score < answer.score), key=lambda c: c.score)
    return tuple(dict.fromkeys(n for c in better for n in c.effects if n not in named))[:MOST_CANDIDATES]
