"""Where longer windows begin: from the fits of the shorter ones of which they are made."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.least_squares import Fit
from pipeline.discovery.mechanisms.problem import OWN_STEP, Problem
from pipeline.discovery.mechanisms.simulation import States, joined


def states_of_longer(before: Problem, found: Fit, problem: Problem, states: States) -> States:
    """States of longer windows that lead through those with which the shorter ones begin.

    A state that a first half determines leads a chaotic motion past its second half, where no fit finds back. The
    second half's own state tells where the motion has to go (multiple shooting: Bock, 1981).

    Args:
        before: The problem with the shorter windows.
        found: What was fitted to them.
        problem: With the longer windows.
        states: Of the longer windows, where none of the shorter ones begins with them.
    """
    begins = {(w.clip, w.rows.start): k for k, w in enumerate(before.windows)}
    pairs = []
    for k, w in enumerate(problem.windows):
        first = begins.get((w.clip, w.rows.start))
        if first is None:
            continue
        states.put(k, found.states.of([first]))
        middle = before.windows[first].rows.stop
        if middle < w.rows.stop and (w.clip, middle) in begins:
            pairs.append((k, first, begins[w.clip, middle]))
    if pairs:
        _lead_through(before, found, states, pairs)
    return states


def _lead_through(before: Problem, found: Fit, states: States, pairs: list[tuple[int, int, int]]) -> None:
    """Change states so that they lead to those of second halves. pairs: a longer window and its two halves."""
    _, firsts, seconds = map(list, zip(*pairs, strict=True))
    windows = [before.windows[f] for f in firsts]
    until = [replace(w, rows=slice(w.rows.start, w.rows.stop + 1)) for w in windows]
    model, begin, size = before.simulator.model, found.states.of(firsts), found.states.size
    variant = found.model.variant(before.mechanism, before.simulator.spec, found.theta)
    steps = OWN_STEP * before.scales
    moved = [begin]
    for k in range(size):
        change = np.zeros((len(pairs), size))
        change[:, k] = steps[k]
        moved.append(begin.moved(model, change))
    ends = before.simulator.ends(until * (size + 1), variant, joined(moved))
    goal = found.states.of(seconds)
    short = [
        _difference(model, ends.of([k * len(pairs) + i]), goal.of([i]))
        for k in range(size + 1)
        for i in range(len(pairs))
    ]
    off = np.reshape(short, (size + 1, len(pairs), size))
    for i, (longer, first, second) in enumerate(pairs):
        slopes = (off[0, i] - off[1:, i]) / steps[:, None]  # (L, L) of the end, by the beginning
        known = found.own[second] @ found.own[second].T
        normal = found.own[first] @ found.own[first].T + np.diag(before.prior) + slopes @ known @ slopes.T
        change = np.linalg.pinv(normal, hermitian=True) @ slopes @ known @ off[0, i]
        if np.isfinite(change).all():
            states.put(longer, begin.of([i]).moved(model, change[None]))


def _difference(model: mujoco.MjModel, one: States, other: States) -> np.ndarray:
    """(L,) by which another state is away from one; of turns it is a rotation vector."""
    turn = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, turn, 1.0, one.position[0], other.position[0])
    return np.concatenate([turn, (other.velocity - one.velocity)[0], (other.activation - one.activation)[0]])
