"""Gauss-Newton on pooled masks and flow, with Levenberg-Marquardt damping.

Derivatives are finite differences of whole simulations, in batches. Objects that never come near each other do not
affect each other's residuals, so their coordinates are perturbed in the same simulations (Curtis, Powell and Reid
1974): three such objects cost as much as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.physics.batch import SceneBatch
from pipeline.scene.solid import bounding_radii
from pipeline.search.evaluator import Evaluator
from pipeline.search.parameters import Space
from pipeline.search.pooled_residuals import INVALID_COST

DAMPINGS = 10.0 ** np.arange(-2.0, 3.5, 1.0)  # factors on the previous damping, tried in one batch
LEAST_DAMPING, MOST_DAMPING = 1e-5, 1e3
RIDGE = 1e-3  # regularises coordinates without effect on the picture; per range, for a residual of 1
NEAR = 1.05  # distance in sums of two bounding radii up to which objects may touch
GAIN = 0.01  # smallest relative decrease of the cost that counts as progress
PATIENCE = 3  # steps without progress after which a descent ends


@dataclass(frozen=True)
class Point:
    """A candidate: coordinates x (D,), reward, IoU, and the cost of each object (N,)."""

    x: np.ndarray
    reward: float
    iou: float
    cost: np.ndarray


@dataclass(frozen=True)
class Linearisation:
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
    """Evaluate candidates.

    Args:
        evaluator: Of the target.
        space: Search space.
        x: Coordinates (B, D).
        pairs: (P, 2) objects and instances.
        first: Number of first frames; None: all.

    Returns:
        Residuals (B, N, R), and a point for each candidate.
    """
    residuals, rewards = evaluator.residuals(space.decode(x), pairs, first)
    points = [Point(x[b], float(rewards.reward[b]), float(rewards.iou[b]), residuals.cost[b]) for b in range(len(x))]
    return residuals.values, points


def neighbours(evaluator: Evaluator, scenes: SceneBatch) -> list[list[int]]:
    """Groups of objects of the first scene of a batch that come near each other, directly or through others."""
    position = evaluator.replay(scenes).position[0]  # (T, N, 3)
    radii = np.array([bounding_radii(s, scenes.half_size[:, i])[0] for i, s in enumerate(scenes.shapes)])
    distance = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1).min(0)
    near = distance < NEAR * (radii[:, None] + radii)
    groups: list[list[int]] = []
    for i in range(len(radii)):
        touched = [g for g in groups if near[i, g].any()]
        groups = [g for g in groups if g not in touched] + [sorted([i, *(k for g in touched for k in g)])]
    return groups


def perturbation_groups(space: Space, groups: list[list[int]]) -> list[list[int]]:
    """Lists of coordinates that one simulation may perturb: a single one of the scene, or one of each group."""
    own = [[d for d in range(len(space.keys)) if space.owner[d] in group] for group in groups]
    longest = max(map(len, own))
    together = [[columns[k] for columns in own if k < len(columns)] for k in range(longest)]
    return [[d] for d in range(len(space.keys)) if space.owner[d] < 0] + together


def linearise(
    evaluator: Evaluator, space: Space, x: np.ndarray, residual: np.ndarray, pairs: np.ndarray, first: int | None
) -> Linearisation:
    """Residuals and their derivatives at a point, by one-sided differences away from the nearer bound.

    Args:
        evaluator: Of the target.
        space: Search space.
        x: Coordinates (D,).
        residual: Residuals (N, R) at x.
        pairs: (P, 2) objects and instances.
        first: Number of first frames; None: all.
    """
    groups = neighbours(evaluator, space.decode(x[None]))
    together = perturbation_groups(space, groups)
    step = np.where(x > 0.5, -space.step, space.step)
    trials = np.repeat(x[None], len(together), axis=0)
    for row, columns in enumerate(together):
        trials[row, columns] += step[columns]
    values, points = evaluate(evaluator, space, trials, pairs, first)
    jacobian = np.zeros((len(x), *residual.shape), np.float32)
    for row, columns in enumerate(together):
        if points[row].cost.max(initial=0) >= INVALID_COST:
            continue  # an unstable simulation has no derivative
        change = values[row] - residual
        for d in columns:
            seen = next((g for g in groups if space.owner[d] in g), range(len(residual)))
            for i in seen:
                jacobian[d, i] = change[i] / step[d]
    return Linearisation(residual, jacobian)


def damped_steps(linear: Linearisation, x: np.ndarray, dampings: np.ndarray) -> np.ndarray:
    """Coordinates (L, D) after a step from x (D,) with each damping (L,). Coordinates at a bound do not cross it."""
    matrix = linear.normal_matrix()
    gradient = (linear.jacobian.reshape(len(x), -1) @ linear.residual.ravel()).astype(float)
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
    """A Gauss-Newton run from one point, advanced step by step.

    Attributes:
        evaluator: Of the target.
        space: Search space.
        pairs: (P, 2) objects and instances.
        first: Number of first frames; None: all.
        point: The point of least cost so far.
        residual: Its residuals (N, R).
        best: The point of best reward so far.
        damping: Levenberg-Marquardt damping.
        idle: Steps in a row without progress.
        linear: Linearisation at `point`, where it is known.
    """

    evaluator: Evaluator
    space: Space
    pairs: np.ndarray
    first: int | None
    point: Point
    residual: np.ndarray
    best: Point
    damping: float = 0.1
    idle: int = 0
    linear: Linearisation | None = None

    @classmethod
    def start(
        cls, evaluator: Evaluator, space: Space, x: np.ndarray, pairs: np.ndarray, first: int | None = None
    ) -> Descent:
        values, (point,) = evaluate(evaluator, space, x[None], pairs, first)
        return cls(
            evaluator=evaluator,
            space=space,
            pairs=pairs,
            first=first,
            point=point,
            residual=values[0],
            best=point,
        )

    @property
    def most_simulations(self) -> int:
        """Upper bound of the simulations of a step, reached where all objects come near each other."""
        return 1 + len(self.space.keys) + len(DAMPINGS)

    @property
    def done(self) -> bool:
        return self.idle >= PATIENCE

    def step(self) -> None:
        """Linearise, evaluate a batch of damped steps, and take the one of least cost if it decreases the cost."""
        if self.linear is None:
            self.linear = linearise(self.evaluator, self.space, self.point.x, self.residual, self.pairs, self.first)
        trials = damped_steps(self.linear, self.point.x, self.damping * DAMPINGS)
        values, points = evaluate(self.evaluator, self.space, trials, self.pairs, self.first)
        costs = np.array([p.cost.sum() for p in points])
        top = int(np.argmin(costs))
        self.best = max([self.best, *points], key=lambda p: p.reward)
        before = self.point.cost.sum()
        self.idle = 0 if costs[top] < (1 - GAIN) * before else self.idle + 1
        if costs[top] < before:
            self.damping = float(np.clip(self.damping * DAMPINGS[top] * 0.5, LEAST_DAMPING, MOST_DAMPING))
            self.point, self.residual, self.linear = points[top], values[top], None
        else:
            self.damping = min(self.damping * 30, MOST_DAMPING)
