"""Gauss-Newton steps on pooled masks and flow, damped as Levenberg and Marquardt's are.

Derivatives are differences of whole simulations, a batch at a time. Objects that never come near each other do not
disturb each other's pictures: their coordinates are stepped in the same simulations (Curtis, Powell, Reid 1974), so
that three objects that keep apart cost what one does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.physics.batch import SceneBatch
from pipeline.scene.solid import bounding_radii
from pipeline.search.evaluator import Evaluator
from pipeline.search.parameters import Space
from pipeline.search.pooled_residuals import INVALID_COST

DAMPINGS = 10.0 ** np.arange(-2.0, 3.5, 1.0)  # times the one that served last: tried together
LEAST_DAMPING, MOST_DAMPING = 1e-5, 1e3
RIDGE = 1e-3  # keeps what no picture shows where it is; of a residual as large as the whole object, per range
NEAR = 1.05  # of the sum of two bounding radii, within which objects may touch
GAIN = 0.01  # least share of the cost that a step has to win
PATIENCE = 3  # steps in a row that win less


@dataclass(frozen=True)
class Point:
    """A candidate: x (D,), its reward and IoU, and the cost of each object's residuals (N,)."""

    x: np.ndarray
    reward: float
    iou: float
    cost: np.ndarray


@dataclass(frozen=True)
class Slope:
    """Residuals (N, R) at a point and their derivatives (D, N, R)."""

    residual: np.ndarray
    jacobian: np.ndarray

    def normal_matrix(self) -> np.ndarray:
        """(D, D) JᵀJ."""
        flat = self.jacobian.reshape(len(self.jacobian), -1)
        return (flat @ flat.T).astype(float)


def evaluate(
    evaluator: Evaluator, space: Space, x: np.ndarray, pairs: np.ndarray, first: int | None
) -> tuple[np.ndarray, list[Point]]:
    """Residuals (B, N, R) and points of vectors (B, D), over the first frames (None: all)."""
    residuals, rewards = evaluator.residuals(space.decode(x), pairs, first)
    points = [Point(x[b], float(rewards.reward[b]), float(rewards.iou[b]), residuals.cost[b]) for b in range(len(x))]
    return residuals.values, points


def neighbours(evaluator: Evaluator, scenes: SceneBatch) -> list[list[int]]:
    """Groups of objects of a batch's one scene that come near each other, directly or through others."""
    position = evaluator.replay(scenes).position[0]  # (T, N, 3)
    radii = np.array([bounding_radii(s, scenes.half_size[:, i])[0] for i, s in enumerate(scenes.shapes)])
    distance = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1).min(0)
    near = distance < NEAR * (radii[:, None] + radii)
    groups: list[list[int]] = []
    for i in range(len(radii)):
        touched = [g for g in groups if near[i, g].any()]
        groups = [g for g in groups if g not in touched] + [sorted([i, *(k for g in touched for k in g)])]
    return groups


def stepped_together(space: Space, groups: list[list[int]]) -> list[list[int]]:
    """Coordinates in lists that may be stepped in one simulation: those of the scene alone, and one of each group."""
    own = [[d for d in range(len(space.keys)) if space.owner[d] in group] for group in groups]
    longest = max(map(len, own))
    together = [[columns[k] for columns in own if k < len(columns)] for k in range(longest)]
    return [[d] for d in range(len(space.keys)) if space.owner[d] < 0] + together


def slope(
    evaluator: Evaluator, space: Space, x: np.ndarray, residual: np.ndarray, pairs: np.ndarray, first: int | None
) -> Slope:
    """Derivatives at x (D,), whose residuals are (N, R), by one-sided differences away from the nearer bound."""
    groups = neighbours(evaluator, space.decode(x[None]))
    together = stepped_together(space, groups)
    step = np.where(x > 0.5, -space.step, space.step)
    trials = np.repeat(x[None], len(together), axis=0)
    for row, columns in enumerate(together):
        trials[row, columns] += step[columns]
    values, points = evaluate(evaluator, space, trials, pairs, first)
    jacobian = np.zeros((len(x), *residual.shape), np.float32)
    for row, columns in enumerate(together):
        if points[row].cost.max(initial=0) >= INVALID_COST:
            continue  # no slope is known there
        change = values[row] - residual
        for d in columns:
            seen = next((g for g in groups if space.owner[d] in g), range(len(residual)))
            for i in seen:
                jacobian[d, i] = change[i] / step[d]
    return Slope(residual, jacobian)


def damped_steps(s: Slope, x: np.ndarray, dampings: np.ndarray) -> np.ndarray:
    """Vectors (L, D) after a step of each damping, inside the bounds; coordinates that a bound stops are left out."""
    matrix = s.normal_matrix()
    gradient = (s.jacobian.reshape(len(x), -1) @ s.residual.ravel()).astype(float)
    scale = np.maximum(np.diag(matrix), RIDGE)
    out = []
    for damping in dampings:
        free = np.ones(len(x), bool)
        for _ in range(3):
            a = matrix[np.ix_(free, free)] + np.diag(damping * scale[free] + RIDGE)
            move = np.zeros(len(x))
            move[free] = -np.linalg.solve(a, gradient[free])
            stopped = free & (((x <= 0) & (move < 0)) | ((x >= 1) & (move > 0)))
            if not stopped.any():
                break
            free &= ~stopped
        out.append(np.clip(x + move, 0, 1))
    return np.array(out)


@dataclass
class Descent:
    """A run of Gauss-Newton from one point, a step at a time: over the first frames (None: all)."""

    evaluator: Evaluator
    space: Space
    pairs: np.ndarray
    first: int | None
    point: Point
    residual: np.ndarray
    best: Point
    damping: float = 0.1
    idle: int = 0
    slope: Slope | None = None

    @classmethod
    def start(
        cls, evaluator: Evaluator, space: Space, x: np.ndarray, pairs: np.ndarray, first: int | None = None
    ) -> Descent:
        values, (point,) = evaluate(evaluator, space, x[None], pairs, first)
        return cls(evaluator, space, pairs, first, point, values[0], point)

    @property
    def most_simulations(self) -> int:
        """What a step costs at most: where every object comes near every other."""
        return 1 + len(self.space.keys) + len(DAMPINGS)

    @property
    def done(self) -> bool:
        return self.idle >= PATIENCE

    def step(self) -> None:
        """One slope and one batch of damped steps; takes the one with the least cost, if that is less."""
        if self.slope is None:
            self.slope = slope(self.evaluator, self.space, self.point.x, self.residual, self.pairs, self.first)
        trials = damped_steps(self.slope, self.point.x, self.damping * DAMPINGS)
        values, points = evaluate(self.evaluator, self.space, trials, self.pairs, self.first)
        costs = np.array([p.cost.sum() for p in points])
        top = int(np.argmin(costs))
        self.best = max([self.best, *points], key=lambda p: p.reward)
        before = self.point.cost.sum()
        self.idle = 0 if costs[top] < (1 - GAIN) * before else self.idle + 1
        if costs[top] < before:
            self.damping = float(np.clip(self.damping * DAMPINGS[top] * 0.5, LEAST_DAMPING, MOST_DAMPING))
            self.point, self.residual, self.slope = points[top], values[top], None
        else:
            self.damping = min(self.damping * 30, MOST_DAMPING)
