"""Forward selection: effects are added to the best models one by one, as long as each wins by enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.discrepancy.fitting.calibration import Calibration
from pipeline.discrepancy.fitting.candidate import Candidate
from pipeline.discrepancy.fitting.extension import (
    CLAIM,
    MOST_FITTED,
    Progress,
    extend,
    has_promising_extension,
    without_one,
)
from pipeline.discrepancy.selection.comparison import likeliest
from pipeline.discrepancy.selection.stability import is_stable
from pipeline.discrepancy.selection.unexplained import UNEXPLAINED_Z, excess, has_few_clips
from pipeline.scene.effects.kind import EffectKind

CLAIM_MORE = 16.0  # by how much the score of a second and a third effect must win
MOST_EFFECTS = 3
MOST_FITTED_MORE = MOST_FITTED - 4  # effects that are fitted at a time to models with an effect
ENOUGH_Z = 2.5  # excess below which no further effect is sought
CORRELATED = 0.1  # noise between neighbouring samples; that of white noise seems less
LEADERS = 2  # models of one effect that a second effect is added to


@dataclass(frozen=True)
class ForwardSelection:
    """chosen: the model that wins; tried: all models of several effects that were fitted."""

    chosen: Candidate
    tried: tuple[Candidate, ...]


def forward_selection(
    calibration: Calibration,
    best: Candidate,
    singles: Sequence[Candidate],
    kinds: Sequence[EffectKind],
    progress: Progress,
) -> ForwardSelection:
    """Add effects to the best model of one effect and to its runner-up.

    Args:
        calibration: Of the problem.
        best: The best model of one effect.
        singles: All models of one effect, the best first.
        kinds: The effects that may be added.
        progress: Called with the name of each effect that is fitted.
    """
    leaders = [c for c in singles if c.score < calibration.none.score - CLAIM][:LEADERS]
    chosen = best
    tried: list[Candidate] = []
    if has_few_clips(calibration.problem):
        return ForwardSelection(chosen, ())
    for _ in range(MOST_EFFECTS - 1):
        if excess(calibration, chosen)[0] < ENOUGH_Z and not (
            _floor_seems_high(calibration, chosen) and has_promising_extension(calibration, chosen, kinds, CLAIM_MORE)
        ):
            break
        longer = [c for base in leaders for c in extend(calibration, base, kinds, progress, MOST_FITTED_MORE)]
        winner = likeliest(longer, chosen)
        if len(winner.effects) == 2:  # what the first effect had to make up for may now cost less
            last = [c for c in singles if c.name == winner.effects[-1] and all(c is not base for base in leaders)]
            longer += [c for base in last for c in extend(calibration, base, kinds, progress, MOST_FITTED_MORE)]
        tried += longer
        winner = likeliest(longer, chosen)
        if winner.score > chosen.score - CLAIM_MORE:
            break
        if excess(calibration, winner)[0] > UNEXPLAINED_Z and not is_stable(calibration, winner):
            break
        shorter = without_one(calibration, winner)
        tried += [c for c in shorter if len(c.effects) > 1]
        least = likeliest(shorter, winner)
        chosen = least if least.score < winner.score + CLAIM_MORE else winner
        leaders = [chosen]
    return ForwardSelection(chosen, tuple(tried))


def _floor_seems_high(calibration: Calibration, chosen: Candidate) -> bool:
    """Whether a model may leave no excess although an effect is missing, because the noise floor is too high.

    Polynomials fit a blow or a quick turn badly: their residuals are then correlated, or larger than the model's.
    """
    correlated = calibration.problem.floor.correlation > CORRELATED
    return calibration.noise_scale > 1 or correlated or excess(calibration, chosen)[0] < -ENOUGH_Z
