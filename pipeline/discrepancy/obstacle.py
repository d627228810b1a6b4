"""An unseen sphere in the way, from where bodies were when their velocity jumped, and in which direction it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.arc import Arc
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.scene.scene import half_extents

LEAST_RADIUS = 0.005  # m


@dataclass(frozen=True)
class Obstacle:
    """position (3,) m and size (radius), m, with their standard errors; misfit: rms distance of the contacts from its
    surface, m; hits: how many jumps it explains."""

    position: np.ndarray
    size: float
    position_error: np.ndarray
    size_error: float
    misfit: float
    hits: int


def fit_obstacle(arcs: Sequence[Arc], known: KnownScene) -> Obstacle | None:
    """The sphere that best explains all jumps of the arcs as hits: centre = body's centre - (radius + size) normal.

    The normal is that of the jump, so that friction at the hit is left out. None where nothing jumps.
    """
    centres, normals, reach = [], [], []
    for arc in arcs:
        radius = float(half_extents(known.of_clip(arc.clip).objects[arc.object]).max())
        for jump in arc.jumps:
            centres.append(jump.position)
            normals.append(jump.jump / np.linalg.norm(jump.jump))
            reach.append(radius)
    if not centres:
        return None
    x, n, r = np.array(centres), np.array(normals), np.array(reach)
    # x - r n = p + R n, linear in (p, R)
    design = np.concatenate([np.tile(np.eye(3), (len(x), 1)), n.reshape(-1, 1)], 1)
    target = (x - r[:, None] * n).ravel()
    ridge = 1e-6 * np.eye(4)
    inverse = np.linalg.inv(design.T @ design + ridge)
    solution = inverse @ (design.T @ target + ridge @ np.array([*x.mean(0), 0.05]))
    size = max(float(solution[3]), LEAST_RADIUS)
    if size != solution[3]:
        solution[:3] = (x - (r + size)[:, None] * n).mean(0)
    misfit = float(np.sqrt(np.mean((target - design @ np.array([*solution[:3], size])) ** 2) * 3))
    spread = max(misfit, 1e-3) * np.sqrt(np.diag(inverse).clip(0, 1e4))
    return Obstacle(solution[:3], size, spread[:3], float(spread[3]), misfit, len(x))
