"""Initial states of arcs to begin fits with, (A, 11) per stack: from simple fits, and other ones for stuck fits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.discovery.fitting.least_squares import Fit, fit_initial_states
from pipeline.discovery.fitting.predictions import STATE_SIZE
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.tracks.stack import ArcStack

STUCK = 1.6  # chi squared per coordinate above which a fit is begun again elsewhere
LEAST_GAIN = 10  # of chi squared of an arc, that makes another initial state worth taking


def initial_states(problem: Problem) -> list[np.ndarray]:
    """The initial states of all arcs, per stack."""
    return [stack_initial_states(s) for s in problem.stacks]


def stack_initial_states(stack: ArcStack) -> np.ndarray:
    """Initial states from straight and parabolic fits to the positions."""
    out = np.zeros((len(stack), STATE_SIZE))
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


def better_initial_states(stacks: Sequence[ArcStack], found: Fit) -> list[np.ndarray] | None:
    """The initial states of a fit, replaced where other ones fit a stuck arc much better; None where none does."""
    out, better = [], False
    for stack, start, chi2 in zip(stacks, found.starts, found.chi2, strict=True):
        best, least = start.copy(), chi2.copy()
        stuck = chi2 > STUCK * np.maximum((stack.weight > 0).sum((1, 2)), 1)
        if stack.grounded and stuck.any():
            for begin in _alternatives(stack, start):
                moved, left = fit_initial_states(stack, found.model, found.theta, begin)
                gain = stuck & (left < least - LEAST_GAIN)
                best[gain], least[gain] = moved[gain], left[gain]
                better |= bool(gain.any())
        out.append(best)
    return out if better else None


def _alternatives(stack: ArcStack, start: np.ndarray) -> list[np.ndarray]:
    """Initial states (A, 11) of bodies on the ground to try beside `start`, because friction causes local minima.

    They have velocities from the first samples alone; unmeasured spins as found, of rolling, and of sliding.
    """
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
