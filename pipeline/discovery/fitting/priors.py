"""Priors of the arcs' own parameters, and prices of parameters that fit noise, in the units of chi squared."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.fitting.model import Model
from pipeline.discovery.fitting.motion import Nodes
from pipeline.discovery.fitting.predictions import FRICTION_PLACE, SCALE_PLACE, STATE_SIZE, free_state, run
from pipeline.discovery.tracks.stack import ArcStack

SPIN_PRIOR = 30.0  # rad/s: standard deviation of an unmeasured spin about that of rolling
FIXED = 1e12  # precision of a prior that fixes a parameter
RIDGE = 1e-12  # relative, of the diagonal: where a motion diverges all derivatives are at their bound and alike
SLIPPING = 0.003  # m/s: a ball whose lowest point is faster slips
SLIP_PRICE = 8.0  # of a ball whose spin was not measured and that slips during most of its arc
FIRST_SLIP = 0.02  # m/s: a larger slip at the start of an arc has a price


def own_covariance(stack: ArcStack, local: np.ndarray) -> np.ndarray:
    """Inverse of `own_precision`, (A, L, L). local (A, L, R): derivatives."""
    return np.linalg.inv(own_precision(stack, local))


def own_precision(stack: ArcStack, local: np.ndarray) -> np.ndarray:
    """Each arc's own normal matrix, (A, L, L), with the priors. local (A, L, R): derivatives.

    Coordinates that a one- or two-dimensional recording does not show are fixed.
    """
    gram, identity = np.einsum("alr,amr->alm", local, local), np.eye(local.shape[1])
    return np.asarray((gram + identity * _prior_precision(stack)[:, None]) * (1 + RIDGE * identity))


def _prior_precision(stack: ArcStack) -> np.ndarray:
    """Precision of the priors of each arc's own parameters, (A, L)."""
    places = free_state(stack)
    shown: np.ndarray = np.max(stack.weight, axis=1) > 0  # (A, 3)
    weak = np.where(places < 3, 1e-2, np.where(places < 6, 1e-4, 1 / SPIN_PRIOR**2))
    centred = centred_precision(stack)[places]
    prior = np.tile(np.where(centred > 0, centred, weak), (len(stack), 1))
    fixed = (places < 6) & ~shown[:, places % 3]
    if not stack.grounded:
        fixed |= (places >= 6) & (places < SCALE_PLACE) & ~stack.unmeasured_spin[:, None]
    if stack.friction_sigma > 0:
        fixed |= (places == FRICTION_PLACE) & ~stack.slides[:, None]
    if stack.tied is not None:  # a free spin would fit the noise of the first samples, the better the more friction
        fixed |= (places >= 6) & (places < 9) & stack.tied[:, None]
    return np.where(fixed, FIXED, prior)


def centred_precision(stack: ArcStack) -> np.ndarray:
    """Precisions of the priors about 0 of an initial state's numbers, (11,): of a spin that was not measured, of a
    length scale, and of a slide's friction; 0 where there is none."""
    out = np.zeros(STATE_SIZE)
    if stack.spin_sigma > 0:
        out[6:9] = 1 / stack.spin_sigma**2
    if stack.length_scale_sigma > 0:
        out[SCALE_PLACE] = 1 / stack.length_scale_sigma**2
    if stack.friction_sigma > 0:
        out[FRICTION_PLACE] = 1 / stack.friction_sigma**2
    return out


def prior_chi2(stack: ArcStack, start: np.ndarray) -> np.ndarray:
    """Chi squared (..., A) of the priors about 0 of initial states (..., A, 11)."""
    precision = np.tile(centred_precision(stack), (len(stack), 1))
    precision[~stack.unmeasured_spin, 6:9] = 0.0
    return (precision * start * start).sum(-1)


def occam_price(stack: ArcStack, local: np.ndarray) -> np.ndarray:
    """Price of the arcs' own length scales, frictions and spins, (A,): the Occam factors of their priors in Laplace's
    approximation of the evidence. local (A, L, R): derivatives.

    Without it, a law that lets balls slide almost without friction wins: spins and velocities then fit their own noise,
    with twice as many parameters as where balls roll.
    """
    places = free_state(stack)
    spins = (places >= 6) & (places < 9)
    out = np.zeros(len(stack))
    if stack.length_scale_sigma == 0 and stack.friction_sigma == 0 and not spins.any():
        return out
    own, prior = own_precision(stack, local), _prior_precision(stack)
    if stack.length_scale_sigma > 0:
        out += _occam_factor(own, prior, places == SCALE_PLACE)
    if stack.friction_sigma > 0:
        out += np.where(stack.slides, _occam_factor(own, prior, places == FRICTION_PLACE), 0.0)
    if spins.any():
        priced = stack.has_spin if stack.grounded else stack.unmeasured_spin
        out += np.where(priced, _occam_factor(own, prior, spins), 0.0)
    return out


def _occam_factor(own: np.ndarray, prior: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Log of how much better the parameters `which` (L,) are known than their priors (A, L) say; own (A, L, L):
    precisions."""
    rest = own[:, ~which][:, :, ~which]
    return np.linalg.slogdet(own)[1] - np.linalg.slogdet(rest)[1] - np.log(prior[:, which]).sum(1)


def slip_price(stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray) -> tuple[int, float]:
    """Balls on the ground whose spin was not measured and that slip during most of their arc, and the price of slip.

    A slip at the start has a price, too: with enough friction a free spin would fit the first sample.
    """
    if not stack.grounded:
        return 0, 0.0
    _, nodes = run(stack, model, theta[None], start[None])
    free = (stack.radius > 0) & ~stack.has_spin & (stack.samples > 0)
    first, late = (_slip_speed(stack, nodes, k)[free] for k in (0, int(0.6 * stack.steps)))
    slipping = int((late > SLIPPING).sum())
    return slipping, SLIP_PRICE * slipping + 2 * float(np.log1p((first / FIRST_SLIP) ** 2).sum())


def _slip_speed(stack: ArcStack, nodes: Nodes, node: int) -> np.ndarray:
    """Speed of the balls' lowest points over the ground at a node of a single run, (A,) m/s."""
    v, w = nodes.velocity[0, :, node], nodes.angular_velocity[0, :, node]
    return np.hypot(v[:, 0] - w[:, 1] * stack.radius, v[:, 1] + w[:, 0] * stack.radius)
