"""The outcome of the selection of effects."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.discovery.fitting.calibration import Calibration
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.selection.local_effect import Where
from pipeline.discovery.tracks.problem import Problem


@dataclass(frozen=True)
class Selection:
    """Which effects the measurements support.

    Attributes:
        calibration: The problem, without arcs that no model explains, and its calibrated model.
        singles: A model for each effect alone, the best first.
        chosen: The model that wins, possibly without effects.
        alike: Sets of effects that cannot be told from one of the chosen model's.
        excess_share: Residual of the chosen model beyond noise, as a share of the calibrated model's.
        excess_z: The same as a z-score.
        unknown: Whether that is too much, or a number that only scales gravity may have absorbed another law.
        untestable: Names of effects that the measurements could not show.
        ruled_out: Names of effects that something beside the motion speaks against.
        baseline: The calibrated model with lengths and noise as they were before nuisances (`select_effects`).
        tried: All models of several effects that were fitted.
        where: Where the known scene fails.
        first: The selection whose residuals count as noise in this one; None where noise is as measured.
    """

    calibration: Calibration
    singles: tuple[Candidate, ...]
    chosen: Candidate
    alike: tuple[tuple[str, ...], ...]
    excess_share: float
    excess_z: float
    unknown: bool
    untestable: tuple[str, ...]
    ruled_out: tuple[str, ...]
    baseline: Candidate
    tried: tuple[Candidate, ...] = ()
    where: Where | None = None
    first: Selection | None = None

    @property
    def problem(self) -> Problem:
        """What was fitted."""
        return self.calibration.problem

    @property
    def measured(self) -> Problem:
        """The problem with its noise as measured."""
        return (self.first or self).problem

    @property
    def none(self) -> Candidate:
        """The calibrated model, without effects."""
        return self.calibration.none

    @property
    def answer(self) -> Candidate:
        """The model behind the verdict: the chosen one, or the calibrated one where the effect is unknown."""
        return self.none if self.unknown else self.chosen
