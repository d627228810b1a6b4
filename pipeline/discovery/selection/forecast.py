"""The error of a model's forecasts: of the last parts of held-out arcs, from their first parts.

A model with more numbers of each arc's own (an unknown spin) always comes nearer to the arc that they are fitted to;
its forecasts are better only if they are right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.predictions import run

SEEN = 0.6  # share of an arc's duration that its own numbers are fitted to


def forecast_error(found: Candidate) -> float:
    """Root mean square over the last parts, in units of the noise; of all clips where none is held out."""
    squares, count = 0.0, 0
    anywhere = any(h.any() for h in found.problem.held)
    for stack, start, held in zip(found.problem.stacks, found.fit.starts, found.problem.held, strict=True):
        late = stack.time > SEEN * stack.duration[:, None]  # (A, n)
        first = replace(stack, weight=np.where(late[..., None], 0.0, stack.weight))
        begin, _ = fit_initial_states(first, found.fit.model, found.fit.theta, start)
        rows, _ = run(stack, found.fit.model, found.fit.theta[None], begin[None])
        predicted = rows[0][:, : stack.weight[0].size].reshape(stack.weight.shape)
        asked = late[..., None] & (stack.weight > 0) & (held | (not anywhere))[:, None, None]
        squares += float(((stack.position * stack.weight - predicted)[asked] ** 2).sum())
        count += int(asked.sum())
    return float(np.sqrt(squares / max(count, 1)))
