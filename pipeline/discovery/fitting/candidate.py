"""A model that may explain the measurements, fitted and scored.

Every model, from none to three effects, has one score: chi squared of the fitted clips, plus BIC's price of its
parameters, plus chi squared of the held-out clips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.bounces import RestitutionFit
from pipeline.discovery.fitting.initial_states import better_initial_states
from pipeline.discovery.fitting.least_squares import MOST_ITERATIONS, Fit, fit
from pipeline.discovery.fitting.model import Model
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.effects.discovery_rules import HitFit


@dataclass(frozen=True)
class Candidate:
    """A fitted and scored model.

    Attributes:
        effects: Names, in the order in which they were added.
        fit: Of the model.
        problem: What it was fitted to.
        score: What models are compared by.
        bic: Of the fitted clips.
        held_out: Chi squared of the held-out clips. All three are corrected for correlated noise.
        restitution: Where an effect gives the bounces a restitution of their own.
        hits: Where an effect explains velocity jumps.
        hits_price: Price of that effect, which score and bic contain.
    """

    effects: tuple[str, ...]
    fit: Fit
    problem: Problem
    score: float
    bic: float
    held_out: float
    restitution: RestitutionFit | None = None
    hits: HitFit | None = None
    hits_price: float = 0.0

    @property
    def name(self) -> str:
        """The effect of a model with one effect."""
        (effect,) = self.effects
        return effect

    @property
    def parameters(self) -> int:
        """Number of fitted parameters that positions determine: of each arc, and shared."""
        return self.problem.own + self.fit.model.size

    @property
    def position_chi2(self) -> float:
        """Chi squared of all positions, in units of the noise floor."""
        return sum(float(c.sum()) for c in self.fit.position_chi2)


def with_hits(found: Candidate, hits: HitFit | None, price: float) -> Candidate:
    """The candidate with an effect that explains velocity jumps, at a price; None: without one."""
    return replace(found, score=found.score + price, bic=found.bic + price, hits=hits, hits_price=price)


def fit_candidate(
    problem: Problem,
    model: Model,
    theta: np.ndarray,
    begin: Sequence[np.ndarray],
    effects: tuple[str, ...],
    *,
    effective_rows: float,
    noise_scale: float,
) -> Candidate:
    """Fit a model, again from other initial states where arcs are stuck, and score it.

    Args:
        problem: What is fitted.
        model: Of the motion.
        theta: (G,) where the fit begins.
        begin: Initial states per stack (A, 11) where the fit begins.
        effects: Names of the model's effects.
        effective_rows: Independent coordinates, which BIC's price depends on.
        noise_scale: Ratio of the noise variance of the noise floor to the actual one.
    """
    iterations = MOST_ITERATIONS if len(effects) < 2 else MOST_ITERATIONS // 2
    found = fit(problem.stacks, model, theta, begin, problem.chosen, iterations=iterations)
    other = better_initial_states(problem.stacks, found)
    if other is not None:
        found = fit(problem.stacks, model, found.theta, other, problem.chosen, iterations=iterations)
    share = problem.floor.information * noise_scale
    inside, outside = found.total(problem.chosen) * share, found.total(problem.held) * share
    bic = inside + model.size * np.log(effective_rows) + found.slip_price
    return Candidate(effects, found, problem, score=bic + outside, bic=bic, held_out=outside)


def residuals_m(problem: Problem, found: Candidate) -> list[np.ndarray]:
    """Measured minus predicted positions of each stack, (A, n, 3) m; 0 where there is no sample."""
    out = []
    for stack, start in zip(problem.stacks, found.fit.starts, strict=True):
        rows, _ = run(stack, found.fit.model, found.fit.theta[None], start[None])
        size = stack.weight.size // max(len(stack), 1)
        predicted = rows[0][:, :size].reshape(stack.weight.shape)
        there = stack.weight > 0
        weight = np.where(there, stack.weight, 1.0)
        out.append(np.where(there, stack.position - predicted / weight, 0.0))
    return out
