"""Candidates compared: by score, and by what is known beside the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.effects.discovery_rules import Number
from pipeline.scene.effects.registry import effect_kinds

ALIKE = 7.0  # difference of scores below which effects are not told apart
FORECASTS_BETTER = 4.0  # two standard errors of a difference of chi squared from 0
OTHER_EVIDENCE = 2 * ALIKE  # what is known beside the motion, in units of the score


class Scored(Protocol):
    """A model that was fitted, of free bodies or of a mechanism."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names, in the order in which they were added."""

    @property
    def score(self) -> float:
        """What models are compared by: the lower, the better."""

    @property
    def bic(self) -> float:
        """Of the fitted clips."""

    @property
    def held_out(self) -> float:
        """Chi squared of the held-out clips."""


class Compared(Protocol):
    """The models that were compared, and the one that was chosen (`Selection`)."""

    @property
    def none(self) -> Scored:
        """The calibrated model, without effects."""

    @property
    def singles(self) -> Sequence[Scored]:
        """A model for each effect alone, the best first."""

    @property
    def tried(self) -> Sequence[Scored]:
        """All models of several effects."""

    @property
    def chosen(self) -> Scored:
        """The model that wins, possibly without effects."""

    @property
    def alike(self) -> tuple[tuple[str, ...], ...]:
        """Sets of effects that cannot be told from one of the chosen model's."""

    @property
    def ruled_out(self) -> tuple[str, ...]:
        """Names of effects that something beside the motion speaks against."""

    @property
    def unknown(self) -> bool:
        """Whether the chosen model leaves too much."""

    @property
    def excess_z(self) -> float:
        """What it leaves beyond noise, as a z-score."""


def likeliest(candidates: Sequence[Candidate], default: Candidate) -> Candidate:
    """The candidate with the best score, other evidence included; `default` of no candidates."""
    return min(candidates, key=with_other_evidence, default=default)


def with_other_evidence(found: Candidate) -> float:
    """A candidate's score, and what is known beside the motion."""
    return found.score - other_evidence(found)


def forecasts_better(found: Candidate, none: Candidate) -> bool:
    """Whether a model's residual on clips that were not fitted is smaller by more than its uncertainty.

    A difference of chi squared of d has a standard error of 2 sqrt(d). What explains bounces or velocity jumps does not
    change the residuals of positions; of that the score decides.
    """
    if not found.problem.held_out or found.hits is not None or found.restitution is not none.restitution:
        return True
    return none.held_out - found.held_out > FORECASTS_BETTER


def other_evidence(found: Candidate) -> float:
    """What is known beside the motion for (positive) or against a candidate's effects, in units of the score.

    An example: cameras run at standard rates, which speaks against a clock error that would make the true frame rate a
    non-standard one.
    """
    return OTHER_EVIDENCE * sum(_evidence(found, name, found.problem) for name in found.effects)


def _evidence(found: Candidate, effect: str, problem: Problem) -> int:
    kind, model = effect_kinds()[effect], found.fit.model
    if kind.discovery.other_evidence is None or problem.frame_rate is None:
        return 0
    values: dict[str, Number] = {}
    errors: dict[str, Number] = {}
    for p in kind.parameters:
        columns = [c for i in range(p.length) if (c := model.column(effect, p.name, i)) is not None]
        value = [float(found.fit.theta[c]) for c in columns]
        error = [float(found.fit.covariance[c, c]) ** 0.5 for c in columns]
        values[p.name], errors[p.name] = (value, error) if p.length > 1 else (value[0], error[0])
    return kind.discovery.other_evidence(values, errors, problem.frame_rate)
