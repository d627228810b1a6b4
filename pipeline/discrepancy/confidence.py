"""How sure a verdict is: probabilities of the candidates, and of the verdict, calibrated on development worlds."""

from __future__ import annotations

import numpy as np

from pipeline.discrepancy.fitter import CLAIM
from pipeline.discrepancy.select import ALIKE, UNEXPLAINED_Z, Selection

TEMPERATURE = 2.0  # scores are divided by it twice over: models are never quite right, so that differences overstate
#: Of verdicts with these margins, what share was right (benchmarks/discovery.py, development seeds); in between linear.
MARGINS = (0.0, 5.0, 10.0, 20.0, 40.0, 80.0)
RIGHT_CLAIM = (0.5, 0.7, 0.85, 0.92, 0.95, 0.97)
FEW_CLIPS = {
    1: 0.8,
    2: 0.85,
    3: 0.93,
}  # of one clip 22 of 22 development worlds were right, but real clips differ from each other
DOUBTFUL = 0.5  # where the noise is all that a model left, or where positions were smoothed
IMPERFECT = 0.8  # where a model leaves more than noise, though little of what there was
SMOOTHED = 1e-4  # m: no camera sees so little scatter from a metre away; what is left may be the smoothing's
RIGHT_NONE = (0.6, 0.85, 0.95, 0.97, 0.97, 0.97)


def probabilities(found: Selection) -> dict[str, float]:
    """Of `none`, `unknown` and every candidate; they sum to 1."""
    scores = {"+".join(c.effects): c.score for c in found.singles}
    scores["+".join(found.chosen.effects) or "none"] = found.chosen.score
    scores["none"] = found.none.score - CLAIM
    names = list(scores)
    values = np.array([scores[n] for n in names])
    weights = np.exp(-(values - values.min()) / 2 / TEMPERATURE)
    lost = 0.9 if found.unknown else 0.02
    shares = (1 - lost) * weights / weights.sum()
    return {**dict(zip(names, map(float, shares), strict=True)), "unknown": lost}


def confidence(found: Selection, names: tuple[str, ...]) -> float:
    """That the verdict, or the set of equivalent effects that it belongs to, is right.

    Of positions that were smoothed none is. Up to three fitted clips hardly show how much clips differ from each
    other: of them no verdict is sure.
    """
    problem = found.none.problem
    most = DOUBTFUL if problem.blunt or problem.sigma < SMOOTHED else FEW_CLIPS.get(len(problem.fitted), 1.0)
    if found.excess_z > UNEXPLAINED_Z and not found.unknown:
        most = min(most, IMPERFECT)
    return min(_confidence(found, names), most)


def _confidence(found: Selection, names: tuple[str, ...]) -> float:
    best = min((c.score for c in found.singles), default=found.none.score)
    if not names:
        return float(np.interp(best - (found.none.score - CLAIM), MARGINS, RIGHT_NONE))
    if names == ("unknown",):
        return float(np.interp(found.excess_z - 5, MARGINS, RIGHT_CLAIM))
    known = {n for group in found.alike for n in group} | set(names)
    rivals = [c.score for c in found.singles if c.name not in known and c.effects != found.ruled_out]
    margin = min([found.none.score - CLAIM, *rivals]) - found.chosen.score
    if len(names) == 1:
        margin = max(margin - ALIKE, 0.0)
    return float(np.interp(margin, MARGINS, RIGHT_CLAIM))
