"""Robust least squares for a simulation: Levenberg-Marquardt with weights that fall with the size of a residual.

scipy's `least_squares` scales robust residuals by their second derivative (Triggs et al., "Bundle adjustment - a modern
synthesis", 2000), which fails where most residuals are far beyond their errors, as at the start of a fit here. It also
asks for one simulation at a time. Where bodies hit each other, a change that moves a contact by one step of the
simulation makes the cost jump. There CMA-ES goes on (Hansen, "The CMA evolution strategy: a tutorial", 2016).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

ROUNDS = 25
DAMPINGS = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0])  # tried at once in each step
LEAST_GAIN = 1e-4  # share of the cost: a smaller gain ends the descent
POPULATION, GENERATIONS, SPREAD = 20, 30, 0.3  # of CMA-ES; the spread in steps
FURTHEST = 3.0  # prior standard deviations: no parameter goes beyond
SOFTNESS = (10.0, 1.0)  # residual from which it counts less, in one descent after another
Residuals = Callable[[np.ndarray], np.ndarray]
"""(B, R) of x (B, P)."""


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
    residuals: Residuals,
    steps: np.ndarray,
    prior: np.ndarray,
    *,
    parts: Sequence[Residuals] = (),
    rough: bool = False,
) -> Descent:
    """Minimise the sum of sqrt(1 + r²) - 1 over residuals r, and of half the squares of x / prior, from x = 0.

    Args:
        residuals: (B, R) of x (B, P), in units of their standard errors.
        steps: (P,) of finite differences.
        prior: (P,) standard deviations of x about 0.
        parts: The residuals that count in first descents, one after another, before all do.
        rough: Go on by CMA-ES.
    """
    x = np.zeros(len(steps))
    count = 0
    for part in parts:
        found = _descend(part, x, steps, prior)
        x, count = found.x, count + found.evaluations
    found = _descend(residuals, x, steps, prior)
    x, cost, count = found.x, found.cost, count + found.evaluations
    if rough:
        x, cost, more = _evolve(lambda rows: _costs(residuals(rows), rows, prior, SOFTNESS[-1]), x, cost, steps)
        count += more
    return Descent(x, found.sigma, cost, count)


def _descend(residuals: Residuals, x: np.ndarray, steps: np.ndarray, prior: np.ndarray) -> Descent:
    """Levenberg-Marquardt from x (P,), first with the larger softness."""
    r = residuals(x[None])[0]
    count, cost = 1, 0.0
    curvature = np.diag(prior**-2)
    for soft in SOFTNESS:
        cost = float(_costs(r[None], x[None], prior, soft)[0])
        for _ in range(ROUNDS):
            jacobian = ((residuals(x + np.diag(steps)) - r) / steps[:, None]).T
            weight = 1 / np.sqrt(1 + (r / soft) ** 2)
            curvature = (jacobian * weight[:, None]).T @ jacobian + np.diag(prior**-2)
            slope = jacobian.T @ (weight * r) + x / prior**2
            scale = np.diag(np.diag(curvature))
            trials = np.stack([x - np.linalg.solve(curvature + d * scale, slope) for d in DAMPINGS])
            trials = np.clip(trials, -FURTHEST * prior, FURTHEST * prior)
            tried = residuals(trials)
            count += len(steps) + len(trials)
            costs = _costs(tried, trials, prior, soft)
            best = int(np.argmin(costs))
            gain = cost - float(costs[best])
            if gain > 0:
                x, r, cost = trials[best], tried[best], float(costs[best])
            if gain < LEAST_GAIN * cost:
                break
    return Descent(x, np.sqrt(np.diag(np.linalg.inv(curvature))), cost, count)


def _evolve(
    costs: Callable[[np.ndarray], np.ndarray], x: np.ndarray, cost: float, steps: np.ndarray
) -> tuple[np.ndarray, float, int]:
    """CMA-ES from x: the best x, its cost, and the evaluations that it took."""
    import cma  # takes most of a second

    options = {"popsize": POPULATION, "maxiter": GENERATIONS, "seed": 1, "verbose": -9, "CMA_stds": steps}
    search = cma.CMAEvolutionStrategy(x, SPREAD, options)
    while not search.stop():
        rows = np.array(search.ask())
        search.tell(list(rows), costs(rows).tolist())
    if search.result.fbest < cost:
        x, cost = np.asarray(search.result.xbest), float(search.result.fbest)
    return x, cost, int(search.result.evaluations)


def _costs(r: np.ndarray, x: np.ndarray, prior: np.ndarray, soft: float) -> np.ndarray:
    robust = soft**2 * (np.sqrt(1 + (r / soft) ** 2) - 1)
    return np.asarray(robust.sum(1) + 0.5 * ((x / prior) ** 2).sum(1))
