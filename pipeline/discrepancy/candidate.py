"""A model that may explain the measurements, fitted and scored."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.discrepancy.fit import Fit
from pipeline.discrepancy.impact import RestitutionFit
from pipeline.discrepancy.obstacle import Obstacle
from pipeline.discrepancy.problem import Problem


@dataclass(frozen=True)
class Candidate:
    """effects: in the order in which they were added. score: what is compared (fitter.py); bic: of the fitted
    clips; held_out: chi squared of the held-out ones; all corrected for correlated noise. obstacle: with its price,
    which score and bic have in them."""

    effects: tuple[str, ...]
    fit: Fit
    problem: Problem
    score: float
    bic: float
    held_out: float
    restitution: RestitutionFit | None = None
    obstacle: Obstacle | None = None
    obstacle_price: float = 0.0

    @property
    def name(self) -> str:
        """The effect of a model of one."""
        (effect,) = self.effects
        return effect

    @property
    def own(self) -> int:
        """Fitted numbers that positions show: of each arc, and shared ones."""
        return self.problem.own + self.fit.model.size

    @property
    def left(self) -> float:
        """Chi squared of all positions, in units of the noise as polynomials have it."""
        return sum(float(c.sum()) for c in self.fit.position_chi2)


def with_obstacle(found: Candidate, obstacle: Obstacle | None, price: float) -> Candidate:
    """The same with an obstacle of that price; None: without one."""
    return replace(found, score=found.score + price, bic=found.bic + price, obstacle=obstacle, obstacle_price=price)
