"""Velocity jumps along arcs as hits by something unseen: where and in which direction each body was hit."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.tracks.velocity_jumps import VelocityJump
from pipeline.scene.effects.discovery_rules import Hits
from pipeline.scene.scene import half_extents

FRICTION_TURN = 0.08  # rad: friction at the hit turns the change of velocity away from the normal
WINDOW = 7  # samples on each side of a jump from which its time is refined
LEAST_WINDOW = 6  # samples in all
COARSE_ERROR = 0.02  # m, of a jump that is not refined


def velocity_jump_hits(problem: Problem) -> Hits | None:
    """The hits of a problem's unexplained velocity jumps; None without any."""
    rows = []
    for arc in problem.arcs:
        radius = float(half_extents(problem.known.of_clip(arc.clip).objects[arc.object]).max())
        for jump in arc.jumps:
            place, change, error = _refined(arc, jump)
            turn = np.hypot(FRICTION_TURN, 1 / max(jump.z, 1.0))
            rows.append((place, change / np.linalg.norm(change), radius, error, turn))
    return Hits(*(np.array(column) for column in zip(*rows, strict=True))) if rows else None


def _refined(arc: Arc, jump: VelocityJump) -> tuple[np.ndarray, np.ndarray, float]:
    """Position (3,) m and change of velocity (3,) m/s of a jump whose time is fitted, and the standard error of the
    position along the path, m."""
    near = np.abs(np.arange(len(arc.time)) - np.searchsorted(arc.time, jump.time) + 0.5) < WINDOW
    others = [b.time for b in arc.jumps if b is not jump]
    for other in others:  # not beyond the next jump
        near &= (arc.time < other) if other > jump.time else (arc.time > other)
    t, x = arc.time[near] - jump.time, arc.position[near]
    if len(t) < LEAST_WINDOW:
        return jump.position, jump.change, COARSE_ERROR
    at, limit = 0.0, float(np.median(np.diff(arc.time)))
    sigma = float(np.median(arc.sigma))
    for _ in range(4):
        design = np.column_stack([np.ones_like(t), t, t * t, np.maximum(0, t - at)])
        beta, *_ = np.linalg.lstsq(design, x, rcond=None)
        by_time = np.where(t > at, -1.0, 0.0)[:, None] * beta[3]  # derivative of the path by the time of the jump
        free = by_time - design @ (np.linalg.pinv(design) @ by_time)
        size = max(float((free * free).sum()), 1e-12)
        at = float(np.clip(at + (free * (x - design @ beta)).sum() / size, -limit, limit))
    speed = float(np.linalg.norm(beta[1] + 0.5 * beta[3]))
    return np.array([1.0, at, at * at]) @ beta[:3], beta[3], speed * min(sigma / np.sqrt(size), limit)
