"""Robust least squares for a simulation: Levenberg-Marquardt with weights that fall with the size of a residual.

scipy's `least_squares` scales robust residuals by their second derivative (Triggs et al., "Bundle adjustment - a modern
synthesis", 2000), which fails where most residuals are far beyond their errors, as at the start of a fit here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

ROUNDS = 25
DAMPINGS = (1e-3, 1e-2, 0.1, 1.0, 10.0)  # tried in turn until the cost falls
LEAST_GAIN = 1e-4  # share of the cost: a smaller gain ends the descent


@dataclass(frozen=True)
class Descent:
    """The best parameters found.

    Attributes:
        x: (P,).
        sigma: (P,) standard errors.
        cost: Half the sum of the robust squares.
        evaluations: Of the residuals.
    """

    x: np.ndarray
    sigma: np.ndarray
    cost: float
    evaluations: int


def robust_descent(
    residuals: Callable[[np.ndarray], np.ndarray], steps: np.ndarray, prior: np.ndarray, rounds: int = ROUNDS
) -> Descent:
    """Minimise the sum of sqrt(1 + r²) - 1 over residuals r, and of half the squares of x / prior, from x = 0.

    Args:
        residuals: Of x (P,), in units of their standard errors; (R,).
        steps: (P,) of finite differences.
        prior: (P,) standard deviations of x about 0.
        rounds: Most steps.
    """
    x = np.zeros(len(steps))
    r = residuals(x)
    cost, count = _cost(r, x, prior), 1
    curvature = np.diag(prior**-2)
    start = 0
    for _ in range(rounds):
        jacobian = np.empty((len(r), len(x)))
        for k, step in enumerate(steps):
            there = x.copy()
            there[k] += step
            jacobian[:, k] = (residuals(there) - r) / step
        count += len(x)
        weight = 1 / np.sqrt(1 + r**2)
        curvature = (jacobian * weight[:, None]).T @ jacobian + np.diag(prior**-2)
        slope = jacobian.T @ (weight * r) + x / prior**2
        before = cost
        for level in range(start, len(DAMPINGS)):
            matrix = curvature + DAMPINGS[level] * np.diag(np.diag(curvature))
            trial = x - np.linalg.solve(matrix, slope)
            there_r = residuals(trial)
            count += 1
            there_cost = _cost(there_r, trial, prior)
            if there_cost < cost:
                x, r, cost = trial, there_r, there_cost
                start = max(level - 1, 0)
                break
        if before - cost < LEAST_GAIN * before:
            break
    return Descent(x, np.sqrt(np.diag(np.linalg.inv(curvature))), cost, count)


def _cost(r: np.ndarray, x: np.ndarray, prior: np.ndarray) -> float:
    return float((np.sqrt(1 + r**2) - 1).sum() + 0.5 * ((x / prior) ** 2).sum())
