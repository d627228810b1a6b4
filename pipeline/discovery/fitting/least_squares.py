"""Weighted least squares in trajectory space: shared parameters, and each arc's own initial state.

Gauss-Newton with Levenberg's damping. The normal equations have an arrow shape, so that the initial states are
eliminated arc by arc (variable projection); derivatives are differences of one batch of integrations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.model import Model
from pipeline.discovery.fitting.predictions import (
    Linearisation,
    free_state,
    linearise,
    measured_rows,
    run,
    tie_spins,
)
from pipeline.discovery.fitting.priors import centred_precision, occam_price, own_covariance, prior_chi2, slip_price
from pipeline.discovery.tracks.stack import ArcStack

MOST_ITERATIONS = 12
DAMPING_TRIALS = 6
LARGEST = 1e12  # of a residual or derivative, in units of sigma
SHARES_FLIGHT, SHARES_GROUND = np.array([1.0, 0.0]), np.array([1.0, 0.5, 0.2, 0.0])


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes:
        model: What was fitted.
        theta: (G,) shared parameters.
        covariance: (G, G), for noise of the stated size.
        starts: Per stack (A, 11), the initial states.
        chi2: Per stack (A,), sum of squared residuals of each arc in units of sigma, with prices.
        position_chi2: Per stack (A,), the same of positions alone, without spins and prices.
        slipping: Number of balls whose spin was not measured and that slip instead of rolling.
        slip_price: Price of their slip.
    """

    model: Model
    theta: np.ndarray
    covariance: np.ndarray
    starts: list[np.ndarray]
    chi2: list[np.ndarray]
    position_chi2: list[np.ndarray]
    slipping: int
    slip_price: float

    def total(self, chosen: Sequence[np.ndarray]) -> float:
        """Chi squared of the arcs chosen, per stack (A,) bool."""
        return float(sum(c[m].sum() for c, m in zip(self.chi2, chosen, strict=True)))


def fit(
    stacks: Sequence[ArcStack],
    model: Model,
    theta: np.ndarray,
    starts: Sequence[np.ndarray],
    fitted: Sequence[np.ndarray],
    *,
    iterations: int = MOST_ITERATIONS,
    tolerance: float = 0.02,
) -> Fit:
    """Fit the shared parameters to some arcs, and every arc's initial state to the arc itself.

    Args:
        stacks: All arcs.
        model: What is fitted.
        theta: (G,) where the fit begins.
        starts: Per stack (A, 11), initial states where the fit begins.
        fitted: Per stack (A,) bool, the arcs that the shared parameters are fitted to.
        iterations: At most.
        tolerance: Decrease of chi squared below which the fit ends.
    """
    theta = theta.copy()
    starts = [s.copy() for s in starts]
    low, high = np.array([u.low for u in model.unknowns]), np.array([u.high for u in model.unknowns])
    centre = model.start
    prior = np.array([1 / u.sigma**2 for u in model.unknowns])
    damping, size = 1e-4, model.size
    chi2 = _chi2(stacks, model, theta, starts)
    covariance, price = np.zeros((size, size)), [np.zeros(len(s)) for s in stacks]
    for _ in range(iterations):
        with np.errstate(all="ignore"):
            linear = linearise(stacks, model, theta, starts)
        if not _is_finite(linear):
            break  # the motion diverges here
        normal, gradient = np.diag(prior), -prior * (theta - centre)
        parts = []
        rows = zip(stacks, starts, linear.residual, linear.local, linear.shared, fitted, strict=True)
        price = [occam_price(s, j) for s, j in zip(stacks, linear.local, strict=True)]
        for stack, start, r, jl, jg, chosen in rows:
            inverse = own_covariance(stack, jl)
            cross = np.einsum("alr,agr->alg", jl, jg)
            own = _own_gradient(stack, jl, r, start)
            reach = np.einsum("alm,amg->alg", inverse, cross)
            parts.append((inverse, cross, own))
            jg, r = jg[chosen], r[chosen]
            normal = normal + np.einsum("agr,ahr->gh", jg, jg) - np.einsum("alg,alh->gh", cross[chosen], reach[chosen])
            gradient = gradient + np.einsum("agr,ar->g", jg, r) - np.einsum("alg,al->g", reach[chosen], own[chosen])
        if size:
            covariance = np.linalg.pinv(normal, hermitian=True)
        before = _objective(chi2, fitted, theta, centre, prior)
        improved = 0.0
        for _ in range(DAMPING_TRIALS):
            change = np.zeros(0)
            if size:
                free = ~(((theta <= low) & (gradient < 0)) | ((theta >= high) & (gradient > 0)))
                damped = normal + damping * np.diag(np.diag(normal))
                change = np.zeros(size)
                if free.any():
                    change[free] = np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
            trial = np.clip(theta + change, low, high)
            trial_starts, trial_chi2 = [], []
            for stack, start, (inverse, cross, own) in zip(stacks, starts, parts, strict=True):
                shift = np.einsum("alm,am->al", inverse, own - cross @ (trial - theta))
                new, left = _best_shift(stack, model, trial, start, shift)
                trial_starts.append(new)
                trial_chi2.append(left)
            after = _objective(trial_chi2, fitted, trial, centre, prior)
            if np.isfinite(after) and after <= before + 1e-9:
                improved = before - after
                theta, starts, chi2 = trial, trial_starts, trial_chi2
                damping = max(damping / 10, 1e-8)
                break
            damping *= 20
        if improved < tolerance:
            break
    slips = [slip_price(s, model, theta, start) for s, start in zip(stacks, starts, strict=True)]
    return Fit(
        model=model,
        theta=theta,
        covariance=covariance,
        starts=starts,
        chi2=[c + p for c, p in zip(chi2, price, strict=True)],
        position_chi2=_chi2(stacks, model, theta, starts, positions_only=True),
        slipping=sum(n for n, _ in slips),
        slip_price=sum(p for _, p in slips),
    )


def fit_initial_states(
    stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray, iterations: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    """The best initial states (A, 11) near `start` for fixed theta, and chi squared of the arcs then (A,)."""
    left = np.full(len(stack), np.inf)
    for _ in range(iterations):
        linear = linearise([stack], model, theta, [start])
        if not _is_finite(linear):
            break
        inverse = own_covariance(stack, linear.local[0])
        gradient = _own_gradient(stack, linear.local[0], linear.residual[0], start)
        shift = np.einsum("alm,am->al", inverse, gradient)
        start, left = _best_shift(stack, model, theta, start, shift)
    return start, left


def _own_gradient(stack: ArcStack, local: np.ndarray, residual: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Negative half gradient of chi squared with respect to each arc's own parameters, (A, L), with the priors of the
    spin and of the length scale."""
    places = free_state(stack)
    prior: np.ndarray = centred_precision(stack)[places] * start[:, places]
    return np.einsum("alr,ar->al", local, residual) - prior


def _is_finite(linear: Linearisation) -> bool:
    """Whether the squares of all numbers can be summed and inverted."""
    parts = (*linear.residual, *linear.local, *linear.shared)
    return all(bool(np.isfinite(a).all() and (np.abs(a) < LARGEST).all()) for a in parts)


def _best_shift(
    stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Initial states after the share of `shift` (A, L) that suits each arc best, and chi squared of the arcs then (A,).

    A step that is the same for all arcs fails where a single body on the ground stops earlier or later.
    """
    shares = SHARES_GROUND if stack.grounded else SHARES_FLIGHT
    begin = np.tile(start, (len(shares), 1, 1))
    begin[:, :, free_state(stack)] += shares[:, None, None] * shift
    tie_spins(stack, begin, start)
    with np.errstate(all="ignore"):
        rows, _ = run(stack, model, np.tile(theta, (len(shares), 1)), begin)
        left = ((measured_rows(stack) - rows) ** 2).sum(-1) + prior_chi2(stack, begin)
    best = np.nanargmin(np.where(np.isfinite(left), left, 1e30), axis=0)
    arcs = np.arange(len(stack))
    return begin[best, arcs], left[best, arcs]


def _chi2(
    stacks: Sequence[ArcStack],
    model: Model,
    theta: np.ndarray,
    starts: Sequence[np.ndarray],
    positions_only: bool = False,
) -> list[np.ndarray]:
    """Per stack (A,), chi squared of each arc with the priors of its own numbers, or of its positions alone."""
    out = []
    with np.errstate(all="ignore"):  # a trial that diverges is refused
        for stack, start in zip(stacks, starts, strict=True):
            rows, _ = run(stack, model, theta[None], start[None])
            squares = (measured_rows(stack) - rows[0]) ** 2
            if positions_only:
                out.append(squares[:, : stack.weight[0].size].sum(1))
            else:
                out.append(squares.sum(1) + prior_chi2(stack, start))
    return out


def _objective(
    chi2: Sequence[np.ndarray], fitted: Sequence[np.ndarray], theta: np.ndarray, centre: np.ndarray, prior: np.ndarray
) -> float:
    return float(sum(c[m].sum() for c, m in zip(chi2, fitted, strict=True)) + (prior * (theta - centre) ** 2).sum())
