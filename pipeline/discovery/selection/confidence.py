"""How sure a verdict is: probabilities of the candidates and of the verdict, calibrated on development worlds."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.fitting.extension import CLAIM
from pipeline.discovery.selection.comparison import ALIKE, Compared
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.selection.unexplained import UNEXPLAINED_Z, has_few_clips
from pipeline.scene.effects.registry import effect_kinds

TEMPERATURE = 2.0  # divides differences of scores, which overstate the evidence because models are never quite right
#: Share of right verdicts at these margins (benchmarks/discovery.py, development seeds); linear in between.
MARGINS = (0.0, 5.0, 10.0, 20.0, 40.0, 80.0)
RIGHT_CLAIM = (0.5, 0.7, 0.85, 0.92, 0.95, 0.97)
RIGHT_NONE = (0.6, 0.85, 0.95, 0.97, 0.97, 0.97)
FEW_CLIPS = {1: 0.8, 2: 0.85, 3: 0.93}
"""Number of fitted clips -> highest confidence. All 22 development worlds of one clip were right, but real clips differ
from each other more than simulated ones."""
DOUBTFUL = 0.5  # highest confidence where a model's residuals count as noise, or where positions were smoothed
IMPERFECT = 0.8  # highest confidence where residuals exceed the noise, though not by much
SMOOTHED = 1e-4  # m: positions with less noise were smoothed: no camera is so exact from a metre away
UNKNOWN_SHARE = 0.9, 0.02  # probability of an effect that is not listed, where the answer is `unknown` and elsewhere


def probabilities(found: Compared) -> dict[str, float]:
    """The probabilities of `none`, `unknown` and every candidate; they sum to 1."""
    scores = {"+".join(c.effects): c.score for c in found.singles}
    scores["+".join(found.chosen.effects) or "none"] = found.chosen.score
    scores["none"] = found.none.score - CLAIM
    names = list(scores)
    values = np.array([scores[n] for n in names])
    weights = np.exp(-(values - values.min()) / 2 / TEMPERATURE)
    lost = UNKNOWN_SHARE[0] if found.unknown else UNKNOWN_SHARE[1]
    shares = (1 - lost) * weights / weights.sum()
    return {**dict(zip(names, map(float, shares), strict=True)), "unknown": lost}


def leaves_more(found: Selection) -> bool:
    """Whether the answer leaves more than noise."""
    return found.unknown or found.first is not None or found.excess_z > UNEXPLAINED_Z


def confidence(found: Selection, names: tuple[str, ...]) -> float:
    """The probability that the verdict, or the set of equivalent effects that contains it, is right.

    Verdicts on smoothed positions are never rated sure. Nor are those on up to three fitted clips, which show
    too little of how much clips differ.
    """
    problem = found.problem
    few = problem.noise_inflated and has_few_clips(problem)
    smoothed = found.measured.sigma < SMOOTHED or found.measured.floor.smoothing.width > 0
    most = DOUBTFUL if few or smoothed else FEW_CLIPS.get(len(problem.fitted), 1.0)
    if leaves_more(found) and not found.unknown:
        most = min(most, IMPERFECT)
    return min(confidence_by_margin(found, names), most)


def confidence_by_margin(found: Compared, names: tuple[str, ...]) -> float:
    """The share of right verdicts at the verdict's margin over its rivals: single effects, and as many effects as it
    names, but for those that are not told apart, and for what contains the verdict as a special case."""
    best = min((c.score for c in found.singles), default=found.none.score)
    if not names:
        return float(np.interp(best - (found.none.score - CLAIM), MARGINS, RIGHT_NONE))
    if names == ("unknown",):
        return float(np.interp(found.excess_z - UNEXPLAINED_Z, MARGINS, RIGHT_CLAIM))
    known = {n for group in found.alike for n in group} | set(names)
    others = (*found.singles, *(c for c in found.tried if len(c.effects) == len(names)))
    rivals = [
        c.score
        for c in others
        if not set(c.effects) <= known and not set(c.effects) & set(found.ruled_out) and not _contains(c.effects, names)
    ]
    margin = min([found.none.score - CLAIM, *rivals]) - found.chosen.score
    return float(np.interp(max(margin - ALIKE, 0.0), MARGINS, RIGHT_CLAIM))


def _contains(effects: tuple[str, ...], names: tuple[str, ...]) -> bool:
    """Whether these effects, with some of their numbers neutral, are the named ones."""
    kinds = effect_kinds()
    special = {(kinds[n].discovery.contains or n) if n in kinds else n for n in effects}
    return set(effects) != set(names) and special == set(names)
