"""The gap between a model and the measurements, in metres, and the noise floor under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.candidate import Candidate
from pipeline.discrepancy.fit import run
from pipeline.discrepancy.problem import Problem


@dataclass(frozen=True)
class Gap:
    """Root mean square over measured coordinates, of the clips `clips`, m; each arc's own initial state costs
    degrees of freedom, so that a perfect model reaches the noise floor, not less."""

    before: float
    after: float
    noise_floor: float
    clips: tuple[str, ...]


def measure_gap(problem: Problem, before: Candidate, after: Candidate) -> Gap:
    """On the held-out clips, or on the fitted ones where none could be held out."""
    held = bool(problem.held_out) and any(h.any() for h in problem.held)
    clips = problem.held_out if held else problem.fitted
    first, last = (_rmse(c.problem, c, c.problem.held if held else c.problem.chosen) for c in (before, after))
    everything = [np.ones(len(s), bool) for s in after.problem.stacks]
    floor = min(problem.sigma, _rmse(after.problem, after, everything))  # polynomials miss kinks that a law may have
    return Gap(first, last, floor, clips)


def _rmse(problem: Problem, found: Candidate, chosen: Sequence[np.ndarray]) -> float:
    squares, count = 0.0, 0
    for stack, rows, mask in zip(problem.stacks, residuals_m(problem, found), chosen, strict=True):
        squares += float((rows[mask] ** 2).sum())
        count += int((stack.weight[mask] > 0).sum()) - stack.own * int((stack.samples[mask] > 0).sum())
    return float(np.sqrt(squares / max(count, 1)))


def residuals_m(problem: Problem, found: Candidate) -> list[np.ndarray]:
    """Measured minus predicted positions of each stack, (A, n, 3) m; 0 where there is no sample."""
    out = []
    for stack, start in zip(problem.stacks, found.fit.starts, strict=True):
        rows, _ = run(stack, found.fit.model, found.fit.theta[None], start[None])
        size = stack.weight.size // max(len(stack), 1)
        predicted = rows[0][:, :size].reshape(stack.weight.shape)
        there = stack.weight > 0
        weight = np.where(there, stack.weight, 1.0)
        out.append(np.where(there, stack.position - predicted / weight, 0.0))
    return out
