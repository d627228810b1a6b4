"""How models of free bodies are made longer and shorter, for the forward selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.discovery.fitting.calibration import Calibration
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import (
    MOST_FITTED,
    Progress,
    extend,
    has_promising_extension,
    with_special_cases,
    without_one,
)
from pipeline.discovery.selection.comparison import with_other_evidence
from pipeline.discovery.selection.forward_selection import CLAIM_MORE
from pipeline.discovery.selection.stability import is_stable
from pipeline.discovery.selection.unexplained import UNEXPLAINED_Z, drop_unexplained_arcs, excess, has_few_clips
from pipeline.scene.effects.kind import EffectKind

MOST_FITTED_MORE = MOST_FITTED - 4  # effects that are fitted at a time to models with an effect
ENOUGH_Z = 2.5  # excess below which no further effect is sought
CORRELATED = 0.1  # noise between neighbouring samples; that of white noise seems less


@dataclass(frozen=True)
class ArcSearch:
    """Models of the arcs of a calibrated problem. kinds: the effects that may be added."""

    calibration: Calibration
    kinds: Sequence[EffectKind]
    progress: Progress

    def longer(self, base: Candidate) -> list[Candidate]:
        """`base` with one effect more, the best first."""
        return extend(self.calibration, base, self.kinds, self.progress, MOST_FITTED_MORE)

    def shorter(self, found: Candidate) -> list[Candidate]:
        """`found` without each one of its effects, and with simpler ones that they contain."""
        return [*without_one(self.calibration, found), *with_special_cases(self.calibration, found)]

    def rank(self, found: Candidate) -> float:
        """A model's score, and what is known beside the motion."""
        return with_other_evidence(found)

    def leaves_noise(self, found: Candidate) -> bool:
        """Whether what a model leaves may be noise, but for a few arcs, or too few clips were fitted to tell.

        Polynomials fit a blow or a quick turn badly: their residuals are then correlated, or larger than the model's,
        and a model may leave no excess although an effect is missing.
        """
        if has_few_clips(self.calibration.problem) or drop_unexplained_arcs(self.calibration, found) is not None:
            return True
        z = excess(self.calibration, found)[0]
        correlated = self.calibration.problem.floor.correlation > CORRELATED
        floor_seems_high = self.calibration.noise_scale > 1 or correlated or z < -ENOUGH_Z
        return z < ENOUGH_Z and not (
            floor_seems_high and has_promising_extension(self.calibration, found, self.kinds, CLAIM_MORE)
        )

    def holds(self, found: Candidate) -> bool:
        """Whether a model's effects are the same without each recording, where it leaves more than noise."""
        return excess(self.calibration, found)[0] <= UNEXPLAINED_Z or is_stable(self.calibration, found)
