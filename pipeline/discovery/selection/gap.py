"""The gap between a model and the measurements, in metres, and the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate, residuals_m
from pipeline.discovery.tracks.problem import Problem


@dataclass(frozen=True)
class Gap:
    """Root mean square residuals over the measured coordinates of some clips, m.

    Each arc's own initial state costs degrees of freedom, so that a perfect model reaches the noise floor, not less.

    Attributes:
        before: Of the calibrated model.
        after: Of the model with the effects found.
        noise_floor: Of the noise.
        clips: Names.
    """

    before: float
    after: float
    noise_floor: float
    clips: tuple[str, ...]

    @property
    def left(self) -> float:
        """What remains beyond noise after, over what there was before; 0 where there was nothing."""
        before, after = (max(gap**2 - self.noise_floor**2, 0.0) for gap in (self.before, self.after))
        return float(np.sqrt(after / before)) if before else 0.0


def measure_gap(problem: Problem, before: Candidate, after: Candidate) -> Gap:
    """The gap on the held-out clips, or on the fitted ones where none could be held out.

    Args:
        problem: With the noise as measured.
        before: The calibrated model.
        after: The model with the effects found.
    """
    held = bool(problem.held_out) and any(h.any() for h in problem.held)
    clips = problem.held_out if held else problem.fitted
    first, last = (_rmse(c, c.problem.held if held else c.problem.chosen) for c in (before, after))
    everything = [np.ones(len(s), bool) for s in after.problem.stacks]
    floor = min(problem.sigma, _rmse(after, everything))  # polynomials do not fit kinks that a law may have
    return Gap(first, last, floor, clips)


def body_gap(model: Candidate, body: int) -> float:
    """Root mean square residual, m, of the arcs of one object, fitted and held out."""
    return _rmse(model, [np.asarray(stack.object == body) for stack in model.problem.stacks])


def _rmse(found: Candidate, chosen: Sequence[np.ndarray]) -> float:
    """Over the chosen arcs, per stack (A,) bool."""
    squares, count = 0.0, 0.0
    for stack, rows, mask in zip(found.problem.stacks, residuals_m(found.problem, found), chosen, strict=True):
        squares += float((rows[mask] ** 2).sum())
        count += float(stack.free_rows(found.problem.floor.smoothing.information)[mask].sum())
    return float(np.sqrt(squares / max(count, 1)))
