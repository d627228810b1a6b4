"""What a model predicts of a stack's measurements, in units of their standard deviations, and its derivatives.

Shapes: P parameter sets, A arcs, G shared parameters, L free initial-state parameters of an arc, R rows (coordinates of
the positions, then of the spins) of an arc. Initial states are (A, 11): position, velocity, angular velocity, and the
relative errors of the arc's own length scale and sliding friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.model import Model
from pipeline.discovery.fitting.motion import Nodes, predict
from pipeline.discovery.tracks.stack import ArcStack

STATE_STEP = np.array([1e-4] * 3 + [2e-3] * 3 + [2e-2] * 3 + [1e-4, 1e-3])
"""Finite differences of an initial state."""
SCALE_PLACE = 9
"""Index of the length scale in an initial state."""
FRICTION_PLACE = 10
"""Index of the sliding friction in an initial state."""
STATE_SIZE = len(STATE_STEP)
SPIN_SCALE = 0.03  # relative: standard deviation of a factor that is common to the measured spins of a recording


@dataclass(frozen=True)
class Linearisation:
    """A model near one set of parameters, in units of sigma.

    Attributes:
        residual: Per stack (A, R), measured minus predicted.
        local: Per stack (A, L, R), derivatives of predictions with respect to the initial states.
        shared: Per stack (A, G, R), derivatives of predictions with respect to the shared parameters.
    """

    residual: list[np.ndarray]
    local: list[np.ndarray]
    shared: list[np.ndarray]


def free_state(stack: ArcStack) -> np.ndarray:
    """Indices of the free parameters of an initial state, (L,)."""
    scale = [SCALE_PLACE] if stack.length_scale_sigma > 0 else []
    friction = [FRICTION_PLACE] if stack.friction_sigma > 0 else []
    if not stack.grounded:
        return np.array([*range(6), *([6, 7, 8] if stack.spin_sigma > 0 else []), *scale])
    return np.array([0, 1, 3, 4, *([6, 7, 8] if (stack.radius > 0).any() else []), *scale, *friction])


def run(stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, Nodes]:
    """Predictions (P, A, R) in units of sigma and the nodes, for theta (P, G) and initial states (P, A, 11)."""
    positions, spins, nodes = predict(stack, model.acting(stack, theta), start, model.friction(stack, theta))
    return _rows(stack, model.as_measured(stack, positions, theta), spins), nodes


def _run(stack: ArcStack, model: Model, theta: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`run` without the nodes, and the positions (P, A, n, 3) m before the camera measures them."""
    positions, spins, _ = predict(stack, model.acting(stack, theta), start, model.friction(stack, theta))
    return _rows(stack, model.as_measured(stack, positions, theta), spins), positions


def measured_rows(stack: ArcStack) -> np.ndarray:
    """The measurements in units of sigma, (A, R)."""
    return _rows(stack, stack.position[None], stack.spin_rows[None])[0]


def _rows(stack: ArcStack, positions: np.ndarray, spins: np.ndarray) -> np.ndarray:
    flat = (positions * stack.weight).reshape(*positions.shape[:2], -1)
    if not stack.grounded:
        return flat
    return np.concatenate([flat, _whitened(stack, (spins * stack.spin_weight).reshape(*spins.shape[:2], -1))], -1)


def _whitened(stack: ArcStack, spins: np.ndarray) -> np.ndarray:
    """Spins (P, A, R) in units of sigma, whitened for the common factor `SPIN_SCALE` of the measured spins.

    The covariance is the identity plus a matrix of rank one, along the measured spins.
    """
    measured = (stack.spin_rows * stack.spin_weight).reshape(len(stack), -1)
    square = (measured * measured).sum(1, keepdims=True)
    excess = (1 - 1 / np.sqrt(1 + SPIN_SCALE**2 * square)) / np.maximum(square, 1e-12)
    return spins - (excess * (spins * measured).sum(-1, keepdims=True)) * measured


def linearise(
    stacks: Sequence[ArcStack], model: Model, theta: np.ndarray, starts: Sequence[np.ndarray]
) -> Linearisation:
    """Residuals and derivatives, by forward differences, at theta (G,) and initial states per stack (A, 11)."""
    residuals, local, shared = [], [], []
    steps = np.array([u.step for u in model.unknowns])
    up = theta + steps <= np.array([u.high for u in model.unknowns])
    steps = np.where(up, steps, -steps)
    for stack, start in zip(stacks, starts, strict=True):
        free = free_state(stack)
        camera = model.camera_columns
        moving = [g for g in range(model.size) if g not in camera]
        sets = 1 + len(free) + len(moving)
        thetas, begin = np.tile(theta, (sets, 1)), np.tile(start, (sets, 1, 1))
        for j, place in enumerate(free):
            begin[1 + j, :, place] += STATE_STEP[place]
        tie_spins(stack, begin, start)
        for j, g in enumerate(moving):
            thetas[1 + len(free) + j, g] += steps[g]
        rows, positions = _run(stack, model, thetas, begin)
        residuals.append(measured_rows(stack) - rows[0])
        derivative = rows[1:] - rows[0]
        local.append((derivative[: len(free)] / STATE_STEP[free][:, None, None]).transpose(1, 0, 2))
        by_number = np.zeros((len(stack), model.size, rows.shape[2]))
        by_number[:, moving] = (derivative[len(free) :] / steps[moving][:, None, None]).transpose(1, 0, 2)
        if stack.camera_error is not None:
            moved = stack.camera_error.derivative(positions[0], theta[camera]) * stack.weight[..., None]  # (A, n, 3, K)
            by_number[:, camera, : stack.weight[0].size] = moved.reshape(len(stack), -1, len(camera)).transpose(0, 2, 1)
        shared.append(by_number)
    return Linearisation(residuals, local, shared)


def tie_spins(stack: ArcStack, changed: np.ndarray, start: np.ndarray) -> None:
    """Change the spins of balls that are assumed to roll as their velocities changed, from `start` (A, 11) to
    `changed` (P, A, 11), which is written to."""
    if stack.tied is not None and stack.tied.any():
        arm = np.where(stack.tied & (stack.radius > 0), 1 / np.where(stack.radius > 0, stack.radius, 1.0), 0.0)
        more = (changed[..., 3:5] - start[:, 3:5]) * arm[:, None]
        changed[..., 6] -= more[..., 1]
        changed[..., 7] += more[..., 0]
