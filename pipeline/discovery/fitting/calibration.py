"""The calibrated model, which has no effects, and what all candidates of a problem share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.bounces import Bounce, RestitutionFit, bounces, fit_restitution
from pipeline.discovery.fitting.candidate import Candidate, fit_candidate
from pipeline.discovery.fitting.initial_states import initial_states
from pipeline.discovery.fitting.model import Model, known_model
from pipeline.discovery.tracks.problem import Problem

FRICTIONS = (0.5, 0.2, 0.07)  # sliding friction at which calibration begins
LEAST_BETTER = 0.1  # BIC by which a later one must be better
LEAST_FREEDOM = 30  # degrees of freedom that tell how large the noise is
LARGEST_RATIO = 0.9  # residual variance of the best model over that of the noise floor, below which it replaces it


@dataclass(frozen=True)
class Calibration:
    """A problem with its calibrated model.

    Attributes:
        problem: What is fitted.
        none: The calibrated model, without effects.
        bounces: What the calibrated model makes of the impacts with the ground.
        restitution: One restitution for all bounces; None where they tell nothing, or where damping is fitted.
        noise_scale: Ratio of the noise variance of the noise floor to the one in use (`rescale_noise`).
    """

    problem: Problem
    none: Candidate
    bounces: tuple[Bounce, ...]
    restitution: RestitutionFit | None
    noise_scale: float = 1.0

    @property
    def information(self) -> float:
        """By what chi squared is multiplied: independent samples per sample, times the noise scale."""
        return self.problem.floor.information * self.noise_scale


def calibrate(problem: Problem) -> Calibration:
    """Fit the known model, without effects.

    The fit begins at several frictions: with too much of it bodies stop at once and nothing tells how much there is.
    """
    model = known_model(problem.known, problem.stacks)
    sliding = [i for i, u in enumerate(model.unknowns) if u.name == "sliding_friction"]
    begin = initial_states(problem)
    none: Candidate | None = None
    for friction in FRICTIONS if sliding else (0.0,):
        theta = model.start
        theta[sliding] = friction
        rows = problem.effective_rows
        found = fit_candidate(problem, model, theta, begin, (), effective_rows=rows, noise_scale=1.0)
        if none is None or found.bic < none.bic - LEAST_BETTER:
            none = found
    assert none is not None
    return calibration_of(problem, none)


def calibration_of(problem: Problem, none: Candidate, noise_scale: float = 1.0) -> Calibration:
    """The calibration whose model without effects is fitted already.

    Args:
        problem: What is fitted.
        none: The model, without the bounces' part of the score.
        noise_scale: As of `Calibration`.
    """
    seen = tuple(bounces(problem, none.fit))
    restitution = None if "damping" in problem.known.fit else fit_restitution(seen)
    plain = Calibration(problem, none, seen, restitution, noise_scale)
    return replace(plain, none=with_bounces(plain, none, False))


def fit_model(
    calibration: Calibration,
    problem: Problem,
    model: Model,
    theta: np.ndarray,
    begin: Sequence[np.ndarray],
    *,
    effects: tuple[str, ...],
) -> Candidate:
    """`fit_candidate` with the calibration's rows and noise scale, without the bounces' part of the score.

    Args:
        calibration: Of the problem.
        problem: What is fitted: the calibration's, or one made from it.
        model: Of the motion.
        theta: (G,) where the fit begins.
        begin: Initial states per stack (A, 11) where the fit begins.
        effects: Names of the model's effects.
    """
    rows, scale = calibration.problem.effective_rows, calibration.noise_scale
    return fit_candidate(problem, model, theta, begin, effects, effective_rows=rows, noise_scale=scale)


def with_bounces(calibration: Calibration, found: Candidate, free: bool) -> Candidate:
    """The candidate with the bounces' part of the score: free: with a restitution of their own, else as known damping
    has them."""
    if calibration.restitution is None:
        return found
    found = replace(found, restitution=calibration.restitution if free else None)
    price = np.log(max(len(calibration.bounces), 2)) if free else 0.0
    term = bounce_chi2(calibration, found) + price
    return replace(found, score=found.score + term, bic=found.bic + term)


def with_free_bounces(calibration: Calibration, found: Candidate) -> Candidate:
    """A candidate of known damping, with a restitution of the bounces' own instead."""
    term = bounce_chi2(calibration, found)
    found = replace(found, score=found.score - term, bic=found.bic - term)
    return with_bounces(calibration, found, True)


def bounce_chi2(calibration: Calibration, found: Candidate) -> float:
    """Chi squared of the bounces: with a restitution of their own, or as known damping has them."""
    if calibration.restitution is None:
        return 0.0
    return calibration.restitution.chi2 if found.restitution else calibration.restitution.chi2_expected


def rescale_noise(calibration: Calibration, best: Candidate) -> Calibration:
    """The calibration with the noise taken from the best model's residuals, where they are below the noise floor.

    Polynomials fit motion badly that turns quickly or stops suddenly.
    """
    freedom = best.problem.rows - best.parameters / best.problem.floor.smoothing.information
    left = best.position_chi2 / max(freedom, 1)
    if best.hits is not None or freedom <= LEAST_FREEDOM or left >= LARGEST_RATIO:
        return calibration
    scaled = replace(calibration, noise_scale=1 / left)
    return replace(scaled, none=rescored(scaled, scaled.none))


def rescored(calibration: Calibration, found: Candidate) -> Candidate:
    """A candidate scored without noise scale, scored with that of the calibration."""
    more = (calibration.noise_scale - 1) * calibration.problem.floor.information
    inside, outside = (more * found.fit.total(arcs) for arcs in (found.problem.chosen, found.problem.held))
    return replace(
        found, score=found.score + inside + outside, bic=found.bic + inside, held_out=found.held_out + outside
    )
