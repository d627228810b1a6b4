"""Robust least squares for a simulation: Levenberg-Marquardt with weights that fall with the size of a residual.

scipy's `least_squares` scales robust residuals by their second derivative (Triggs et al., "Bundle adjustment - a modern
synthesis", 2000), which fails where most residuals are far beyond their errors, as at the start of a fit here. It also
asks for one simulation at a time. Where bodies hit something, a change that moves a contact by one step of the
simulation makes the cost jump, and the descent ends in one of many minima. There CMA-ES goes on (Hansen, "The CMA
evolution strategy: a tutorial", 2016), from the better of two starts and with the covariance of the descent, which
then ends the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

ROUNDS = 25
DAMPINGS = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0])  # tried at once in each step
LEAST_GAIN = 1e-4  # share of the cost: a smaller gain ends the descent
POPULATION, GENERATIONS = 20, 30  # of CMA-ES
SPREAD = 0.3  # of its first population, in standard errors of the descent
RESTARTS, LEAST_FALL = 3, 0.01  # of CMA-ES, each where the last one ended; share of the cost: a smaller fall ends them
FURTHEST = 3.0  # prior standard deviations: no parameter goes beyond
SOFTNESS = (10.0, 1.0)  # residual from which it counts less, in one descent after another
Residuals = Callable[[np.ndarray], np.ndarray]
"""(B, R) of x (B, P)."""


@dataclass(frozen=True)
class Descent:
    """The best parameters found.

    Attributes:
        x: (P,).
        root: (P, P), whose product with its transpose is the covariance of x.
        cost: Half the sum of the robust squares.
        evaluations: Of the residuals.
    """

    x: np.ndarray
    root: np.ndarray
    cost: float
    evaluations: int


def robust_descent(
    residuals: Residuals,
    steps: np.ndarray,
    prior: np.ndarray,
    *,
    parts: Sequence[Residuals] = (),
    cma_evaluations: int = 0,
) -> Descent:
    """Minimise the sum of sqrt(1 + r²) - 1 over residuals r, and of half the squares of x / prior, from x = 0.

    Args:
        residuals: (B, R) of x (B, P), in units of their standard errors.
        steps: (P,) of finite differences.
        prior: (P,) standard deviations of x about 0.
        parts: The residuals that count in the first descents of a second start, one after another, before all do.
        cma_evaluations: The cost jumps: go on by CMA-ES, with at most so many evaluations in all.
    """
    found = _descend(residuals, np.zeros(len(steps)), steps, prior, SOFTNESS)
    count = found.evaluations
    if parts:
        x = np.zeros(len(steps))
        for part in parts:
            first = _descend(part, x, steps, prior, SOFTNESS[:1])
            x, count = first.x, count + first.evaluations
        other = _descend(residuals, x, steps, prior, SOFTNESS)
        found, count = min(found, other, key=lambda d: d.cost), count + other.evaluations
    for _ in range(RESTARTS):
        if cma_evaluations < POPULATION:
            break
        x, more = _evolve(lambda rows: _costs(residuals(rows), rows, prior, SOFTNESS[-1]), found, cma_evaluations)
        ended = _descend(residuals, x, steps, prior, SOFTNESS[-1:])
        count, cma_evaluations = count + more + ended.evaluations, cma_evaluations - more
        fall, found = found.cost - ended.cost, min(found, ended, key=lambda d: d.cost)
        if fall < LEAST_FALL * found.cost:
            break
    return replace(found, evaluations=count)


def _descend(
    residuals: Residuals, x: np.ndarray, steps: np.ndarray, prior: np.ndarray, softness: Sequence[float]
) -> Descent:
    """Levenberg-Marquardt from x (P,) with one softness after another."""
    r = residuals(x[None])[0]
    count, cost = 1, 0.0
    curvature = np.diag(prior**-2)
    for soft in softness:
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
    # in units of the prior no curvature is below 1
    root = prior[:, None] * np.linalg.inv(np.linalg.cholesky(prior[:, None] * curvature * prior)).T
    return Descent(x, root, cost, count)


def _evolve(costs: Callable[[np.ndarray], np.ndarray], found: Descent, most: int) -> tuple[np.ndarray, int]:
    """CMA-ES from where a descent ended: the best x (P,), and the evaluations that it took, at most about `most`."""
    import cma  # takes most of a second

    # The residuals that are left tell how far the descent may be off.
    spread = SPREAD * max(float(np.sqrt(found.cost / len(found.x))), 1.0)
    generations = min(GENERATIONS, most // POPULATION)
    options = {"popsize": POPULATION, "maxiter": generations, "seed": 1, "verbose": -9}
    search = cma.CMAEvolutionStrategy(np.zeros(len(found.x)), spread, options)
    while not search.stop():
        rows = np.array(search.ask())
        search.tell(list(rows), costs(found.x + rows @ found.root.T).tolist())
    return found.x + found.root @ search.result.xbest, int(search.result.evaluations)


def _costs(r: np.ndarray, x: np.ndarray, prior: np.ndarray, soft: float) -> np.ndarray:
    robust = soft**2 * (np.sqrt(1 + (r / soft) ** 2) - 1)
    return np.asarray(robust.sum(1) + 0.5 * ((x / prior) ** 2).sum(1))
