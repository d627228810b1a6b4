"""An unseen sphere in the way, from where bodies were when their velocity jumped, and in which direction it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.arc import Arc
from pipeline.discrepancy.breaks import Break
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.scene.scene import half_extents

LEAST_RADIUS = 0.005  # m
SIZE_GUESS, SIZE_SPREAD = 0.2, 0.3  # m: what is known of the size of things before they are hit; one hit adds little
CONTACT_ERROR = 0.015  # m: bodies and contacts are not quite rigid; MuJoCo's sink in by up to 0.04 at 8 m/s
FRICTION_TURN = 0.08  # rad: friction of the hit turns the blow away from the normal
MOST_OFF = 4.0  # standard errors
WINDOW = 7  # samples on each side of a jump from which its time is refined


@dataclass(frozen=True)
class Obstacle:
    """position (3,) m and size (radius), m, with their standard errors; misfit: rms distance of the contacts from its
    surface, m; hits: how many jumps it explains. size_error is that of the guess where one hit determines none."""

    position: np.ndarray
    size: float
    position_error: np.ndarray
    size_error: float
    misfit: float
    hits: int


def fit_obstacle(arcs: Sequence[Arc], known: KnownScene) -> Obstacle | None:
    """The sphere that best explains all jumps of the arcs as hits: centre = body's centre - (radius + size) normal.

    The normal is that of the jump, so that friction at the hit is left out. A jump that is far from what the others
    say (an outlier among few samples) is left out. None where nothing jumps.
    """
    hits = []
    for arc in arcs:
        radius = float(half_extents(known.of_clip(arc.clip).objects[arc.object]).max())
        for jump in arc.jumps:
            place, blow, error = refined(arc, jump)
            turn = np.hypot(FRICTION_TURN, 1 / max(jump.z, 1.0))
            hits.append((place, blow / np.linalg.norm(blow), radius, error, turn))
    if not hits:
        return None
    x, n = (np.array([h[k] for h in hits]) for k in (0, 1))
    r, place_error, turn = (np.array([h[k] for h in hits]) for k in (2, 3, 4))
    kept = np.ones(len(hits), bool)
    while True:
        solution, inverse = _sphere(x[kept], n[kept], r[kept], place_error[kept], turn[kept])
        off = x - (r + solution[3])[:, None] * n - solution[:3]
        z = np.linalg.norm(off, axis=1) / np.hypot(np.hypot(CONTACT_ERROR, place_error), (r + solution[3]) * turn)
        if z[kept].max() < MOST_OFF or kept.sum() == 1:
            break
        kept[np.argmax(np.where(kept, z if kept.sum() > 2 else turn, -1))] = False  # of two, the weaker blow
    misfit = float(np.sqrt(np.mean((off[kept] ** 2).sum(1))))
    freedom = 3 * int(kept.sum()) - 4
    scatter = np.sqrt(max(float((z[kept] ** 2).sum()) / freedom, 1.0)) if freedom > 2 else 1.0
    spread = scatter * np.sqrt(np.diag(inverse))
    size = max(float(solution[3]), LEAST_RADIUS)
    return Obstacle(solution[:3], size, spread[:3], float(spread[3]), misfit, int(kept.sum()))


def _sphere(
    x: np.ndarray, n: np.ndarray, r: np.ndarray, place_error: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre and radius (4,) and their covariance: x - r n = p + R n, linear in (p, R); turn (h,): error of the
    normals, rad."""
    design = np.concatenate([np.tile(np.eye(3), (len(x), 1)), n.reshape(-1, 1)], 1)
    target, size = (x - r[:, None] * n).ravel(), SIZE_GUESS
    prior = np.array([1e-4, 1e-4, 1e-4, 1 / SIZE_SPREAD**2])
    for _ in range(3):
        error = np.hypot(np.hypot(CONTACT_ERROR, place_error), (r + size) * turn)
        weight = np.repeat(1 / error**2, 3)
        inverse = np.linalg.inv(design.T @ (weight[:, None] * design) + np.diag(prior))
        solution = inverse @ (design.T @ (weight * target) + prior * np.array([*x.mean(0), SIZE_GUESS]))
        size = max(float(solution[3]), LEAST_RADIUS)
    return solution, inverse


def refined(arc: Arc, jump: Break) -> tuple[np.ndarray, np.ndarray, float]:
    """Place (3,) m and jump of velocity (3,) m/s, with its time fitted; and the error of the place along the path,
    m."""
    near = np.abs(np.arange(len(arc.time)) - np.searchsorted(arc.time, jump.time) + 0.5) < WINDOW
    others = [b.time for b in arc.jumps if b is not jump]
    for other in others:  # not beyond the next jump
        near &= (arc.time < other) if other > jump.time else (arc.time > other)
    t, x = arc.time[near] - jump.time, arc.position[near]
    if len(t) < 6:
        return jump.position, jump.jump, 0.02
    at, limit = 0.0, float(np.median(np.diff(arc.time)))
    sigma = float(np.median(arc.sigma))
    for _ in range(4):
        design = np.column_stack([np.ones_like(t), t, t * t, np.maximum(0, t - at)])
        beta, *_ = np.linalg.lstsq(design, x, rcond=None)
        later = (
            np.where(t > at, -1.0, 0.0)[:, None] * beta[3]
        )  # derivative of the path with respect to the time of the jump
        free = later - design @ (np.linalg.pinv(design) @ later)
        size = max(float((free * free).sum()), 1e-12)
        at = float(np.clip(at + (free * (x - design @ beta)).sum() / size, -limit, limit))
    speed = float(np.linalg.norm(beta[1] + 0.5 * beta[3]))
    return np.array([1.0, at, at * at]) @ beta[:3], beta[3], speed * min(sigma / np.sqrt(size), limit)
