"""Weighted least squares in trajectory space: shared numbers, and each window's own initial state.

Gauss-Newton with Levenberg's damping; the normal equations have an arrow shape, so that the initial states are
eliminated window by window (variable projection). It is the scheme of pipeline/discovery/fitting/least_squares.py,
which integrates rigid bodies in arrays; here MuJoCo's rollouts of windows of unequal length take its place, and
derivatives by initial states, which are most of the work, are kept from one iteration to the next while they serve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.mechanisms.law_model import STEP, WEAK, LawModel
from pipeline.discovery.mechanisms.problem import OWN_STEP, Problem, predicted
from pipeline.discovery.mechanisms.simulation import LARGEST, States

MOST_ITERATIONS = 10
TRIALS = 6
SHARES = (0.3, 0.0)  # of a window's own step, tried where the whole step makes it worse
TOLERANCE = 0.2  # of chi squared in units of the residuals' own variance, below which a fit ends
SLOW = 0.5  # share of the predicted decrease, below which derivatives by initial states are computed again


@dataclass(frozen=True)
class Forecast:
    """What a window forecasts.

    Attributes:
        residual: Measured minus forecast, in units of the noise, in the rows that were not fitted.
        columns: Which column each number is of.
        chi2: Of the residual, given how well the fitted rows determine the numbers that it depends on (its Mahalanobis
            distance): a small error of a frequency grows with time.
    """

    residual: np.ndarray
    columns: np.ndarray
    chi2: float


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes:
        model: What was fitted.
        theta: (G,) shared numbers.
        covariance: (G, G), for noise of the stated size.
        states: Of the windows.
        residual: Per window, measured minus predicted in units of the noise.
        own: Per window, derivatives by its initial state (L, numbers).
        ahead: Of the windows that make a forecast.
        determined: How many of the shared numbers the data determine better than their weak priors.
        falling: By how much the last iteration decreased chi squared, as it is counted (`counted`).
    """

    model: LawModel
    theta: np.ndarray
    covariance: np.ndarray
    states: States
    residual: list[np.ndarray]
    own: list[np.ndarray]
    ahead: list[Forecast]
    determined: float
    falling: float = 0.0

    @property
    def chi2(self) -> np.ndarray:
        """(W,) of each window."""
        return np.array([float(r @ r) for r in self.residual])


def fit(
    problem: Problem,
    model: LawModel,
    theta: np.ndarray,
    states: States,
    own: Sequence[np.ndarray] | None = None,
    *,
    iterations: int = MOST_ITERATIONS,
) -> Fit:
    """Fit the shared numbers to the fitted windows, and every window's initial state to the window itself.

    Args:
        problem: What is fitted.
        model: Of the mechanism.
        theta: (G,) where the fit begins.
        states: Where the windows begin.
        own: Derivatives by initial states of a fit nearby; None: they are computed.
        iterations: At most.
    """
    unknowns = model.unknowns
    low, high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
    size = np.array([u.size for u in unknowns])
    moves = size > 0
    centre = np.array([u.start for u in unknowns])
    prior = np.where(moves, 1 / (WEAK * np.where(moves, size, 1.0)) ** 2, 0.0)
    theta = np.clip(theta, low, high)
    residual = residuals(problem, model, theta, states)
    kept = None if own is None else list(own)
    fresh, damping = False, 1e-3
    covariance, determined, improved = np.zeros((len(theta), len(theta))), 0.0, 0.0
    for _ in range(iterations):
        if kept is None:
            kept, fresh = derivatives_by_states(problem, model, theta, states), True
        shared = derivatives(problem, model, theta, states, residual)
        normal, gradient = np.diag(prior), -prior * (theta - centre)
        parts, typical = [], typical_square(problem, residual)
        weight = np.minimum(1.0, typical / np.maximum(_mean_squares(residual), typical))
        for w, (r, jl, jg) in enumerate(zip(residual, kept, shared, strict=True)):
            inverse = problem.state_covariance(jl)
            cross, mine = jl @ jg.T, jl @ r
            parts.append((inverse, cross, mine))
            if problem.chosen[w]:
                normal = normal + weight[w] * (jg @ jg.T - cross.T @ inverse @ cross)
                gradient = gradient + weight[w] * (jg @ r - cross.T @ inverse @ mine)
        covariance, determined = _information(normal, prior, moves)
        before = _objective(problem, residual, typical, theta, centre, prior)
        enough = TOLERANCE * max(before / max(problem.count, 1), 1.0)
        gains = weight * np.array([float(m @ i @ m) for i, _, m in parts])
        improved = expected = 0.0
        for _ in range(TRIALS):
            change = np.zeros(len(theta))
            free = moves & ~(((theta <= low) & (gradient < 0)) | ((theta >= high) & (gradient > 0)))
            if free.any():
                damped = normal + damping * np.diag(np.maximum(np.diag(normal), prior))
                change[free] = np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
            shared_gain = float(change @ gradient)
            expected = shared_gain + float(gains[problem.chosen].sum())
            if shared_gain + float(gains.sum()) < enough:
                break
            trial = np.clip(theta + change, low, high)
            shifts = np.stack([i @ (m - c @ (trial - theta)) for i, c, m in parts])
            trial_states, trial_residual = _best_shift(problem, model, trial, states, residual, shifts)
            after = _objective(problem, trial_residual, typical, trial, centre, prior)
            if np.isfinite(after) and after <= before + 1e-9:
                improved = before - after
                theta, states, residual = trial, trial_states, trial_residual
                damping = max(damping / 10, 1e-7)
                break
            damping *= 20
        if improved < enough and (fresh or expected < enough):
            break
        if improved < SLOW * expected or improved < enough:
            kept = None  # computed again in the next iteration
        fresh = False
    if kept is None:
        kept = derivatives_by_states(problem, model, theta, states)
    ahead = [_forecast(problem, model, theta, states, prior, w) for w in problem.ahead]
    return Fit(model, theta, covariance, states, residual, kept, ahead, determined, improved)


def _forecast(
    problem: Problem, model: LawModel, theta: np.ndarray, states: States, prior: np.ndarray, window: int
) -> Forecast:
    """What a window forecasts, from its initial state and the shared numbers that were fitted.

    Args:
        problem: What was fitted.
        model: Of the mechanism.
        theta: (G,) fitted.
        states: Where the windows begin.
        prior: (G,) precisions.
        window: Index of the window.
    """
    whole = problem.forecast
    begin = states.of(problem.ahead)
    k = problem.ahead.index(window)
    residual = residuals(whole, model, theta, begin)
    slopes = np.concatenate(
        [
            derivatives(whole, model, theta, begin, residual)[k],
            derivatives_by_states(whole, model, theta, begin)[k],
        ]
    )
    columns, seen = whole.columns(k), problem.columns(window)
    late = np.concatenate([np.arange((columns == c).sum()) >= (seen == c).sum() for c in np.unique(columns)])
    left, early, later = residual[k][late], slopes[:, ~late], slopes[:, late]
    precision = early @ early.T + np.diag(np.concatenate([prior, problem.prior]))
    ridge = np.diag(np.where(np.diag(precision) > 0, 0.0, 1.0))  # numbers that fits do not change
    pull = later @ left
    most = pull @ np.linalg.solve(precision + ridge + later @ later.T, pull)
    return Forecast(left, columns[late], max(float(left @ left - most), 0.0))


def _information(normal: np.ndarray, prior: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, float]:
    """Covariance (G, G), and how many numbers are determined: the trace of data over data and priors."""
    covariance = np.zeros_like(normal)
    if not moves.any():
        return covariance, 0.0
    some = np.ix_(moves, moves)
    inverse = np.linalg.pinv(normal[some], hermitian=True)
    covariance[some] = inverse
    return covariance, float(np.clip(moves.sum() - np.trace(inverse @ np.diag(prior[moves])), 0, moves.sum()))


def residuals(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> list[np.ndarray]:
    """Measured minus predicted, per window (numbers,), in units of the noise."""
    return [_bounded(t - p) for t, p in zip(problem.targets, motions(problem, model, theta, states), strict=True)]


def motions(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> list[np.ndarray]:
    """What a model predicts, per window (numbers,), in units of the noise; not finite where the motion diverges."""
    variant = model.variant(problem.mechanism, problem.simulator.spec, theta)
    jobs = [(w, 0) for w in range(len(problem.windows))]
    return predicted(problem, jobs, problem.simulator.predict(problem.windows, [variant], jobs, states))


def derivatives(
    problem: Problem, model: LawModel, theta: np.ndarray, states: States, residual: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Derivatives of the predictions by the shared numbers, per window (G, numbers). residual: at theta."""
    steps = []
    for k, u in enumerate(model.unknowns):
        step = STEP * u.size
        steps.append(-step if theta[k] + step > u.high else step)
    moving = [k for k, step in enumerate(steps) if step != 0]
    variants = [
        model.variant(problem.mechanism, problem.simulator.spec, theta + np.eye(len(theta))[k] * steps[k])
        for k in moving
    ]
    out = [np.zeros((len(theta), len(r))) for r in residual]
    if not moving:
        return out
    count = len(problem.windows)
    jobs = [(w, v) for v in range(len(variants)) for w in range(count)]
    values = problem.simulator.predict(
        problem.windows, variants, jobs, states.of(np.tile(np.arange(count), len(moving)))
    )
    for (w, v), p in zip(jobs, predicted(problem, jobs, values), strict=True):
        here = problem.targets[w] - residual[w]
        out[w][moving[v]] = _bounded((p - here) / steps[moving[v]])
    return out


def derivatives_by_states(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> list[np.ndarray]:
    """Derivatives of the predictions by each window's own initial state, per window (L, numbers)."""
    variant = model.variant(problem.mechanism, problem.simulator.spec, theta)
    count, size = len(problem.windows), states.size
    steps = OWN_STEP * problem.scales
    varied = states.varied(problem.mechanism.model, steps)
    jobs = [(w, 0) for _ in range(size + 1) for w in range(count)]
    values = predicted(problem, jobs, problem.simulator.predict(problem.windows, [variant], jobs, varied))
    return [
        np.stack([_bounded((values[(k + 1) * count + w] - values[w]) / steps[k]) for k in range(size)])
        for w in range(count)
    ]


def _best_shift(
    problem: Problem,
    model: LawModel,
    theta: np.ndarray,
    states: States,
    residual: Sequence[np.ndarray],
    shifts: np.ndarray,
) -> tuple[States, list[np.ndarray]]:
    """The states after the share of its shift (W, L) that suits each window best, and the residuals then.

    A part of the shift is tried only for windows that the whole one makes worse, by more than ends a fit.
    """
    variant = model.variant(problem.mechanism, problem.simulator.spec, theta)

    def tried(windows: Sequence[int], trials: States) -> list[np.ndarray]:
        jobs = [(w, 0) for w in windows]
        values = predicted(problem, jobs, problem.simulator.predict(problem.windows, [variant], jobs, trials))
        return [_bounded(problem.targets[w] - p) for w, p in zip(windows, values, strict=True)]

    best = states.moved(problem.mechanism.model, shifts)
    left = tried(range(len(problem.windows)), best)
    worse = [w for w, (new, old) in enumerate(zip(left, residual, strict=True)) if new @ new > old @ old + TOLERANCE]
    for share in SHARES if worse else ():
        trials = states.of(worse).moved(problem.mechanism.model, share * shifts[worse])
        for k, (w, new) in enumerate(zip(worse, tried(worse, trials), strict=True)):
            if new @ new < left[w] @ left[w]:
                left[w] = new
                best.position[w], best.velocity[w] = trials.position[k], trials.velocity[k]
                best.activation[w] = trials.activation[k]
    return best, left


def _mean_squares(residual: Sequence[np.ndarray]) -> np.ndarray:
    """(W,) of each window's residuals."""
    return np.array([float(r @ r) / max(len(r), 1) for r in residual])


def counted(residual: Sequence[np.ndarray], typical: float) -> np.ndarray:
    """Chi squared of each window, (W,), which counts by its logarithm where it is more than typical.

    Near an unstable equilibrium a window may be far off until the numbers are right, and must not decide them.
    """
    worse = np.maximum(_mean_squares(residual) / typical, 1e-300)
    return np.where(worse > 1, 1 + np.log(worse), worse) * typical * np.array([len(r) for r in residual])


def typical_square(problem: Problem, residual: Sequence[np.ndarray]) -> float:
    """The median mean square of the fitted windows, at least that of the noise."""
    return max(float(np.median(_mean_squares(residual)[problem.chosen])), 1.0)


def _objective(
    problem: Problem,
    residual: Sequence[np.ndarray],
    typical: float,
    theta: np.ndarray,
    centre: np.ndarray,
    prior: np.ndarray,
) -> float:
    """What a fit decreases."""
    return float(counted(residual, typical)[problem.chosen].sum()) + float((prior * (theta - centre) ** 2).sum())


def _bounded(x: np.ndarray) -> np.ndarray:
    """A motion that diverges is far off, not undefined."""
    return np.clip(np.nan_to_num(x, nan=LARGEST, posinf=LARGEST, neginf=-LARGEST), -LARGEST, LARGEST)
