"""Where longer windows begin: from the fits of the shorter ones of which they are made."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.least_squares import Fit
from pipeline.discovery.mechanisms.problem import OWN_STEP, Problem
from pipeline.discovery.mechanisms.simulation import States


def states_of_longer(before: Problem, found: Fit, problem: Problem, states: States) -> States:
    """States of longer windows that lead through those with which the shorter ones begin.

    In chaotic motion a state that was fitted to a first half does not predict the second half, and no fit gets back to
    it. So it is changed to lead to the state that was fitted to the second half (multiple shooting: Bock, 1981).

    Args:
        before: The problem with the shorter windows.
        found: What was fitted to them.
        problem: With the longer windows.
        states: Of the longer windows, where none of the shorter ones begins with them.
    """
    begins = {(w.clip, w.rows.start): k for k, w in enumerate(before.windows)}
    out, pairs = states.of(np.arange(len(states))), []
    for k, w in enumerate(problem.windows):
        first = begins.get((w.clip, w.rows.start))
        if first is None:
            continue
        out.put(k, found.states.of([first]))
        middle = before.windows[first].rows.stop
        if middle < w.rows.stop and (w.clip, middle) in begins:
            pairs.append((k, first, begins[w.clip, middle]))
    if pairs:
        longer, firsts, seconds = map(list, zip(*pairs, strict=True))
        for k, state in zip(longer, _leading(before, found, firsts, seconds), strict=True):
            out.put(k, state)
    return out


def _leading(before: Problem, found: Fit, firsts: list[int], seconds: list[int]) -> list[States]:
    """The state of each first half, changed to lead to that of its second half. firsts, seconds: indices of windows."""
    model, begin = before.simulator.model, found.states.of(firsts)
    windows = [before.windows[f] for f in firsts]
    until = [replace(w, rows=slice(w.rows.start, w.rows.stop + 1)) for w in windows]
    variant = found.model.variant(before.mechanism, before.simulator.spec, found.theta)
    steps = OWN_STEP * before.scales
    ends = before.simulator.ends(until, variant, begin.varied(model, steps))
    out = []
    for i, (first, second) in enumerate(zip(firsts, seconds, strict=True)):
        goal = found.states.of([second])
        off = np.array([_difference(model, ends.of([k]), goal) for k in range(i, len(ends), len(firsts))])
        slopes = (off[0] - off[1:]) / steps[:, None]  # (L, L) of the end, by the beginning
        known = found.own[second] @ found.own[second].T
        normal = before.state_information(found.own[first]) + slopes @ known @ slopes.T
        change = np.linalg.pinv(normal, hermitian=True) @ slopes @ known @ off[0]
        state = begin.of([i])
        out.append(state.moved(model, change[None]) if np.isfinite(change).all() else state)
    return out


def _difference(model: mujoco.MjModel, one: States, other: States) -> np.ndarray:
    """(L,) by which another state is away from one; of turns it is a rotation vector."""
    turn = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, turn, 1.0, one.position[0], other.position[0])
    return np.concatenate([turn, (other.velocity - one.velocity)[0], (other.activation - one.activation)[0]])
