"""The coordinates that an effect changes, and what models leave in them.

A body that slides, or a direction in which tracking wanders, may leave much more than an effect that acts elsewhere
removes. So an effect is judged where it acts: in the coordinates, in the air and on the ground apart, whose predictions
it changes most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate, residuals_m
from pipeline.discovery.tracks.problem import Problem

LEAST_CHANGE = 0.5  # of the largest one: a coordinate that changes less is not touched


@dataclass(frozen=True)
class Touched:
    """Coordinates of the held-out arcs.

    Attributes:
        axes: (S, 3) bool, x, y and z of each stack.
        noise_floor: Standard deviation of a coordinate, m.
    """

    axes: np.ndarray
    noise_floor: float

    def left(self, found: Candidate) -> float:
        """What a model leaves in these coordinates beyond noise on held-out clips, root mean square, m."""
        squares, counts = _sums(found.problem, residuals_m(found.problem, found))
        size = float(squares[self.axes].sum()) / max(float(counts[self.axes].sum()), 1.0)
        return float(np.sqrt(max(size - self.noise_floor**2, 0.0)))


def touched(shorter: Candidate, longer: Candidate, noise_floor: float) -> Touched:
    """The coordinates in which two models differ most.

    Args:
        shorter: A model.
        longer: The same with one effect more.
        noise_floor: Standard deviation of a coordinate, m.
    """
    residuals = zip(residuals_m(shorter.problem, shorter), residuals_m(longer.problem, longer), strict=True)
    squares, counts = _sums(longer.problem, [a - b for a, b in residuals])
    change = np.sqrt(squares / np.maximum(counts, 1.0))
    return Touched((counts > 0) & (change >= LEAST_CHANGE * change.max()), noise_floor)


def _sums(problem: Problem, rows: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squares (S, 3) m² of each stack's rows (A, n, 3) m on held-out clips, and their degrees of freedom."""
    squares, counts = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    for i, (stack, row, held) in enumerate(zip(problem.stacks, rows, problem.held, strict=True)):
        there = stack.weight[held] > 0  # (A, n, 3)
        free = stack.free_rows(problem.floor.smoothing.information)[held] / np.maximum(there.sum((1, 2)), 1)
        squares[i] = (row[held] ** 2 * there).sum((0, 1))
        counts[i] = (there.sum(1) * free[:, None]).sum(0)
    return squares, counts
