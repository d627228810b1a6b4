"""Weighted least squares in trajectory space: shared parameters and each arc's own initial state.

Gauss-Newton with Levenberg's damping. The normal equations have an arrow's shape, so that initial states are eliminated
arc by arc (variable projection); derivatives are differences of one batch of integrations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.model import Model
from pipeline.discrepancy.motion import Nodes, predict
from pipeline.discrepancy.stack import ArcStack

LOCAL_STEP = np.array([1e-4] * 3 + [2e-3] * 3 + [2e-2] * 3 + [1e-4])
SPIN_PRIOR = 30.0  # rad/s: how far a body's unknown spin may be from that of rolling
MOST_ITERATIONS = 12
LARGEST = 1e12  # derivative, in units of sigma
SPIN_SCALE = 0.03  # relative: how far the measured spins of a recording are off, all alike
SLIPPING = 0.003  # m/s
SLIP_PRICE = 8.0  # of a ball on the ground whose unknown spin is taken not to be that of rolling
FIRST_SLIP = 0.02  # m/s, above which a slip in the beginning costs
FIXED = 1e12  # a prior that lets nothing move
STUCK = 1.6  # chi squared per coordinate above which another beginning is tried
SHARES_FLIGHT, SHARES_GROUND = np.array([1.0, 0.0]), np.array([1.0, 0.5, 0.2, 0.0])


@dataclass(frozen=True)
class Linear:
    """A model near theta: per stack the residuals (A, R), derivatives with respect to the initial states (A, L, R)
    and to theta (A, G, R), of predictions in units of sigma."""

    residual: list[np.ndarray]
    local: list[np.ndarray]
    shared: list[np.ndarray]


@dataclass(frozen=True)
class Fit:
    """A fitted model. theta (G,); covariance (G, G), for noise of the stated size; starts: per stack (A, 10). chi2:
    per stack the sum of squared residuals of each arc (A,), in units of sigma; position_chi2: that of positions alone,
    without spins and prices. slipping: how many balls of unknown spin slip instead of rolling; slip_price: what that
    costs, in the units of chi squared."""

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


def other_starts(stack: ArcStack, start: np.ndarray) -> list[np.ndarray]:
    """Initial states (A, 10) to try beside `start` for bodies on the ground, whose friction makes for local minima:
    velocities from the first samples alone, and unknown spins of bodies that slide instead of rolling."""
    if not stack.grounded:
        return []
    early = start.copy()
    for i in range(len(stack)):
        there = np.flatnonzero(stack.weight[i].max(1) > 0)[:8]
        if len(there) >= 4:
            t, x = stack.time[i, there], stack.position[i, there]
            beta, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(t), t]), x, rcond=None)
            early[i, :2], early[i, 3:5] = beta[0, :2], beta[1, :2]
    out = [early]
    rolls = stack.radius > 0
    if rolls.any():
        rolling, still = early.copy(), early.copy()
        radius = np.where(rolls, stack.radius, 1.0)
        rolling[:, 6], rolling[:, 7] = -early[:, 4] / radius, early[:, 3] / radius
        still[:, 6:8] = 0.0
        out += [np.where((rolls & ~stack.has_spin)[:, None], s, early) for s in (rolling, still)]
    return out


def settled(
    stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray, iterations: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    """The best initial states (A, 10) near `start` for fixed theta, and chi squared of the arcs then (A,)."""
    left = np.full(len(stack), np.inf)
    for _ in range(iterations):
        linear = linearise([stack], model, theta, [start])
        if not _finite(linear):
            break
        inverse = local_inverse(stack, linear.local[0])
        shift = np.einsum("alm,am->al", inverse, _pull(stack, linear.local[0], linear.residual[0], start))
        start, left = _best_shift(stack, model, theta, start, shift)
    return start, left


def unstuck(stacks: Sequence[ArcStack], found: Fit) -> list[np.ndarray] | None:
    """Initial states from other beginnings where they suit an arc better by far; None where none does."""
    out, better = [], False
    for stack, start, chi2 in zip(stacks, found.starts, found.chi2, strict=True):
        best, least = start.copy(), chi2.copy()
        stuck = chi2 > STUCK * np.maximum((stack.weight > 0).sum((1, 2)), 1)
        if stack.grounded and stuck.any():
            for begin in other_starts(stack, start):
                moved, left = settled(stack, found.model, found.theta, begin)
                gain = stuck & (left < least - 10)
                best[gain], least[gain] = moved[gain], left[gain]
                better |= bool(gain.any())
        out.append(best)
    return out if better else None


def first_starts(stack: ArcStack) -> np.ndarray:
    """Initial states (A, 10) from straight and parabolic fits to the positions."""
    out = np.zeros((len(stack), 10))
    for i in range(len(stack)):
        there = stack.weight[i].max(1) > 0
        if not there.any():
            continue
        t, x = stack.time[i, there], stack.position[i, there]
        if stack.grounded:
            design = np.column_stack([np.ones_like(t), t, t * t])
        else:
            x = x - 0.5 * stack.gravity[i] * (t * t)[:, None]
            design = np.column_stack([np.ones_like(t), t])
        beta, *_ = np.linalg.lstsq(design, x, rcond=None)
        out[i, :3], out[i, 3:6] = beta[0], beta[1]
        out[i, 6:9] = stack.spin[i]
        if stack.grounded:
            out[i, 5] = 0.0
            out[i, 2] = x[:, 2].mean()
            if not stack.has_spin[i] and stack.radius[i] > 0:
                out[i, 6:8] = np.array([-beta[1, 1], beta[1, 0]]) / stack.radius[i]
            elif stack.radius[i] > 0:
                known = stack.spin_weight[i, :, 0] > 0
                out[i, 6:9] = stack.spin_rows[i, known][:3].mean(0)
    return out


def _locals(stack: ArcStack) -> np.ndarray:
    """Which numbers of the initial state are free, by their places in the ten."""
    ruler = [9] if stack.ruler > 0 else []
    if not stack.grounded:
        return np.array([*range(6), *ruler])
    return np.array([0, 1, 3, 4, *([6, 7, 8] if (stack.radius > 0).any() else []), *ruler])


def _rows(stack: ArcStack, positions: np.ndarray, spins: np.ndarray) -> np.ndarray:
    """Predictions in units of sigma, (P, A, R)."""
    flat = (positions * stack.weight).reshape(*positions.shape[:2], -1)
    if not stack.grounded:
        return flat
    return np.concatenate([flat, _unscaled(stack, (spins * stack.spin_weight).reshape(*spins.shape[:2], -1))], -1)


def _unscaled(stack: ArcStack, spins: np.ndarray) -> np.ndarray:
    """Spins (P, A, R) in units of sigma, with less weight on what a wrong scale of the measured ones would change: they
    are off by a common factor, `SPIN_SCALE`, more than from sample to sample (whitening by a matrix of rank one)."""
    measured = (stack.spin_rows * stack.spin_weight).reshape(len(stack), -1)
    square = (measured * measured).sum(1, keepdims=True)
    excess = (1 - 1 / np.sqrt(1 + SPIN_SCALE**2 * square)) / np.maximum(square, 1e-12)
    return spins - (excess * (spins * measured).sum(-1, keepdims=True)) * measured


def _measured(stack: ArcStack) -> np.ndarray:
    """The measurements in units of sigma, (A, R)."""
    return _rows(stack, stack.position[None], stack.spin_rows[None])[0]


def run(stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, Nodes]:
    """Predictions in units of sigma (P, A, R) and the nodes, for theta (P, G) and initial states (P, A, 10)."""
    positions, spins, nodes = predict(stack, model.acting(stack, theta), start, model.friction(stack, theta))
    return _rows(stack, positions, spins), nodes


def linearise(stacks: Sequence[ArcStack], model: Model, theta: np.ndarray, starts: Sequence[np.ndarray]) -> Linear:
    """Residuals and derivatives, by forward differences."""
    residuals, local, shared = [], [], []
    steps = np.array([u.step for u in model.unknowns])
    up = theta + steps <= np.array([u.high for u in model.unknowns])
    steps = np.where(up, steps, -steps)
    for stack, start in zip(stacks, starts, strict=True):
        free = _locals(stack)
        sets = 1 + len(free) + model.size
        thetas, begin = np.tile(theta, (sets, 1)), np.tile(start, (sets, 1, 1))
        for j, place in enumerate(free):
            begin[1 + j, :, place] += LOCAL_STEP[place]
        _roll_on(stack, begin, start)
        for g in range(model.size):
            thetas[1 + len(free) + g, g] += steps[g]
        rows, _ = run(stack, model, thetas, begin)
        residuals.append(_measured(stack) - rows[0])
        derivative = rows[1:] - rows[0]
        local.append((derivative[: len(free)] / LOCAL_STEP[free][:, None, None]).transpose(1, 0, 2))
        shared.append((derivative[len(free) :] / steps[:, None, None]).transpose(1, 0, 2))
    return Linear(residuals, local, shared)


def _roll_on(stack: ArcStack, changed: np.ndarray, start: np.ndarray) -> None:
    """Let the spins of balls that are taken to roll follow their velocities, from `start` (A, 10) to changed
    (P, A, 10)."""
    if stack.tied is not None and stack.tied.any():
        arm = np.where(stack.tied & (stack.radius > 0), 1 / np.where(stack.radius > 0, stack.radius, 1.0), 0.0)
        more = (changed[..., 3:5] - start[:, 3:5]) * arm[:, None]
        changed[..., 6] -= more[..., 1]
        changed[..., 7] += more[..., 0]


def local_inverse(stack: ArcStack, local: np.ndarray) -> np.ndarray:
    """Inverse of each arc's own normal matrix, (A, L, L), with weak priors on what is not measured; what a recording
    of fewer than three coordinates does not show stays as it is."""
    gram = np.einsum("alr,amr->alm", local, local)
    return np.linalg.inv(gram + np.eye(gram.shape[1]) * _local_prior(stack)[:, None])


def _local_prior(stack: ArcStack) -> np.ndarray:
    """Precision of the priors of each arc's own numbers, (A, L)."""
    places = _locals(stack)
    shown: np.ndarray = np.max(stack.weight, axis=1) > 0  # (A, 3)
    weak = np.where(places < 3, 1e-2, np.where(places < 6, 1e-4, 1 / SPIN_PRIOR**2))
    prior = np.tile(np.where(places == 9, _ruler_weight(stack), weak), (len(stack), 1))
    hidden = (places < 6) & ~shown[:, places % 3]
    if stack.tied is not None:  # a free spin would fit the noise of the first samples, the better the more friction
        hidden |= (places >= 6) & (places < 9) & stack.tied[:, None]
    return np.where(hidden, FIXED, prior)


def _ruler_weight(stack: ArcStack) -> float:
    return 1 / stack.ruler**2 if stack.ruler > 0 else 0.0


def _pull(stack: ArcStack, linear_local: np.ndarray, residual: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Gradient of each arc's own numbers, (A, L), that of the ruler's prior included."""
    pull = np.einsum("alr,ar->al", linear_local, residual)
    if stack.ruler > 0:
        pull[:, -1] -= _ruler_weight(stack) * start[:, 9]
    return pull


def occam_price(stack: ArcStack, local: np.ndarray) -> np.ndarray:
    """What the arcs' own length scales and measured spins cost, (A,), in the units of chi squared: Occam's factors
    (Laplace's approximation of the evidence) of their priors.

    A law under which balls hardly feel the ground lets spins and velocities fit their own noise, twice as many numbers
    as where balls roll.
    """
    places = _locals(stack)
    spins = (places >= 6) & (places < 9)
    out = np.zeros(len(stack))
    if stack.ruler == 0 and not spins.any():
        return out
    own, prior = np.linalg.inv(local_inverse(stack, local)), _local_prior(stack)
    if stack.ruler > 0:
        out += _factor(own, prior, places == 9)
    if spins.any():
        out += np.where(stack.has_spin, _factor(own, prior, spins), 0.0)
    return out


def _factor(own: np.ndarray, prior: np.ndarray, which: np.ndarray) -> np.ndarray:
    """How much better `which` of each arc's numbers are known than their priors (A, L) say, of precisions (A, L, L)."""
    rest = own[:, ~which][:, :, ~which]
    return np.linalg.slogdet(own)[1] - np.linalg.slogdet(rest)[1] - np.log(prior[:, which]).sum(1)


def fit(
    stacks: Sequence[ArcStack], model: Model, theta: np.ndarray, starts: Sequence[np.ndarray],
    fitted: Sequence[np.ndarray], iterations: int = MOST_ITERATIONS, tolerance: float = 0.02,
) -> Fit:  # fmt: skip
    """Fit the shared parameters to the arcs `fitted` (per stack (A,) bool), and every arc's initial state to itself."""
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
        if not _finite(linear):
            break  # a law that blows up here leads nowhere
        normal, gradient = np.diag(prior), -prior * (theta - centre)
        parts = []
        rows = zip(stacks, starts, linear.residual, linear.local, linear.shared, fitted, strict=True)
        price = [occam_price(s, j) for s, j in zip(stacks, linear.local, strict=True)]
        for stack, start, r, jl, jg, chosen in rows:
            inverse = local_inverse(stack, jl)
            cross = np.einsum("alr,agr->alg", jl, jg)
            own = _pull(stack, jl, r, start)
            reach = np.einsum("alm,amg->alg", inverse, cross)
            parts.append((inverse, cross, own))
            jg, r = jg[chosen], r[chosen]
            normal = normal + np.einsum("agr,ahr->gh", jg, jg) - np.einsum("alg,alh->gh", cross[chosen], reach[chosen])
            gradient = gradient + np.einsum("agr,ar->g", jg, r) - np.einsum("alg,al->g", reach[chosen], own[chosen])
        if size:
            covariance = np.linalg.pinv(normal, hermitian=True)
        before = _objective(chi2, fitted, theta, centre, prior)
        improved = 0.0
        for _ in range(6):
            change = np.zeros(0)
            if size:
                free = ~(((theta <= low) & (gradient < 0)) | ((theta >= high) & (gradient > 0)))
                damped = normal + damping * np.diag(np.diag(normal))
                change = np.zeros(size)
                if free.any():
                    change[free] = np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
            trial = np.clip(theta + change, low, high)
            moved, trial_chi2 = [], []
            for stack, start, (inverse, cross, own) in zip(stacks, starts, parts, strict=True):
                shift = np.einsum("alm,am->al", inverse, own - cross @ (trial - theta))
                new, left = _best_shift(stack, model, trial, start, shift)
                moved.append(new)
                trial_chi2.append(left)
            after = _objective(trial_chi2, fitted, trial, centre, prior)
            if np.isfinite(after) and after <= before + 1e-9:
                improved = before - after
                theta, starts, chi2 = trial, moved, trial_chi2
                damping = max(damping / 10, 1e-8)
                break
            damping *= 20
        if improved < tolerance:
            break
    position = _chi2(stacks, model, theta, starts, positions_only=True)
    slips = [_slipping(s, model, theta, start) for s, start in zip(stacks, starts, strict=True)]
    priced = [c + p for c, p in zip(chi2, price, strict=True)]
    return Fit(model, theta, covariance, starts, priced, position, sum(n for n, _ in slips), sum(p for _, p in slips))


def _slipping(stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray) -> tuple[int, float]:
    """Balls on the ground whose spin was not measured and that slip for most of their arc instead of rolling; and what
    slipping costs: late, and at first, where friction that grips at once would let a free spin fit the first sample."""
    if not stack.grounded:
        return 0, 0.0
    _, nodes = run(stack, model, theta[None], start[None])
    free = (stack.radius > 0) & ~stack.has_spin & (stack.samples > 0)
    first, late = (_slip(stack, nodes, k)[free] for k in (0, int(0.6 * stack.steps)))
    slipping = int((late > SLIPPING).sum())
    return slipping, SLIP_PRICE * slipping + 2 * float(np.log1p((first / FIRST_SLIP) ** 2).sum())


def _slip(stack: ArcStack, nodes: Nodes, node: int) -> np.ndarray:
    """Speed of the balls' lowest points over the ground at a node of a single run, (A,) m/s."""
    v, w = nodes.velocity[0, :, node], nodes.angular_velocity[0, :, node]
    return np.hypot(v[:, 0] - w[:, 1] * stack.radius, v[:, 1] + w[:, 0] * stack.radius)


def _finite(linear: Linear) -> bool:
    """Whether the numbers are such that their squares can be summed and inverted."""
    parts = (*linear.residual, *linear.local, *linear.shared)
    return all(bool(np.isfinite(a).all() and (np.abs(a) < LARGEST).all()) for a in parts)


def _best_shift(
    stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Initial states after the share of `shift` (A, L) that suits each arc best, and chi squared of the arcs then:
    steps of the whole vector fail where a single body on the ground stops earlier or later."""
    shares = SHARES_GROUND if stack.grounded else SHARES_FLIGHT
    begin = np.tile(start, (len(shares), 1, 1))
    begin[:, :, _locals(stack)] += shares[:, None, None] * shift
    _roll_on(stack, begin, start)
    with np.errstate(all="ignore"):
        rows, _ = run(stack, model, np.tile(theta, (len(shares), 1)), begin)
        left = ((_measured(stack) - rows) ** 2).sum(-1) + _ruler_weight(stack) * begin[..., 9] ** 2
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
    out = []
    with np.errstate(all="ignore"):  # a trial that runs away is refused
        for stack, start in zip(stacks, starts, strict=True):
            rows, _ = run(stack, model, theta[None], start[None])
            squares = (_measured(stack) - rows[0]) ** 2
            if positions_only:
                out.append(squares[:, : stack.weight[0].size].sum(1))
            else:
                out.append(squares.sum(1) + _ruler_weight(stack) * start[:, 9] ** 2)
    return out


def _objective(
    chi2: Sequence[np.ndarray], fitted: Sequence[np.ndarray], theta: np.ndarray, centre: np.ndarray, prior: np.ndarray
) -> float:
    return float(sum(c[m].sum() for c, m in zip(chi2, fitted, strict=True)) + (prior * (theta - centre) ** 2).sum())
