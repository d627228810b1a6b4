"""Motion of flat bodies: discs under gravity among line segments, with bounces, rolling, sliding and collisions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from training.segmentation.backgrounds import log_uniform

STEPS_PER_SECOND = 480
KINDS = ("throw", "drop", "incline", "ledge", "pucks", "level", "carried")


@dataclass(frozen=True)
class FlatMotion:
    """In units of the picture's height, y down. position: (S, N, 2), angle: (S, N) rad, at STEPS_PER_SECOND. radius:
    (N,). segments: (K, 2, 2) that carry bodies. release: (N,) s until when a hand holds it, else 0. kind: of KINDS."""

    position: np.ndarray
    angle: np.ndarray
    radius: np.ndarray
    segments: np.ndarray
    release: np.ndarray
    kind: str


@kernel
def integrate(
    position: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
    radius: np.ndarray,
    rolls: np.ndarray,
    release: np.ndarray,
    segments: np.ndarray,
    gravity: float,
    drag: float,
    bounce: float,
    step: float,
    positions: np.ndarray,
    angles: np.ndarray,
) -> None:
    """Fill positions (S, N, 2) and angles (S, N). velocity (N, 2) per s, spin (N,) rad/s, rolls (N,): else a body that
    touches lies along the segment."""
    count = position.shape[0]
    angle = np.zeros(count)
    for s in range(positions.shape[0]):
        for i in range(count):
            positions[s, i, 0], positions[s, i, 1], angles[s, i] = position[i, 0], position[i, 1], angle[i]
            if s * step < release[i]:
                continue
            velocity[i, 1] += gravity * step
            velocity[i, 0] *= 1 - drag * step
            velocity[i, 1] *= 1 - drag * step
            position[i, 0] += velocity[i, 0] * step
            position[i, 1] += velocity[i, 1] * step
            angle[i] += spin[i] * step
            for k in range(segments.shape[0]):
                ax, ay = segments[k, 0, 0], segments[k, 0, 1]
                bx, by = segments[k, 1, 0] - ax, segments[k, 1, 1] - ay
                length2 = bx * bx + by * by
                u = min(max(((position[i, 0] - ax) * bx + (position[i, 1] - ay) * by) / length2, 0.0), 1.0)
                dx, dy = position[i, 0] - ax - u * bx, position[i, 1] - ay - u * by
                distance = math.sqrt(dx * dx + dy * dy) + 1e-9
                if distance >= radius[i]:
                    continue
                nx, ny = dx / distance, dy / distance
                position[i, 0] += nx * (radius[i] - distance)
                position[i, 1] += ny * (radius[i] - distance)
                inward = velocity[i, 0] * nx + velocity[i, 1] * ny
                if inward < 0:
                    back = bounce if inward < -3 * gravity * step - 0.02 else 0.0
                    velocity[i, 0] -= (1 + back) * inward * nx
                    velocity[i, 1] -= (1 + back) * inward * ny
                if rolls[i]:
                    # Along the tangent (-ny, nx), a disc that touches below turns clockwise when it moves right.
                    spin[i] = (velocity[i, 0] * -ny + velocity[i, 1] * nx) / radius[i]
                else:
                    want = math.atan2(by, bx)
                    want -= math.pi * math.floor((want - angle[i]) / math.pi + 0.5)
                    angle[i] += 0.1 * (want - angle[i])
                    spin[i] = 0.0
        for i in range(count):
            for j in range(i):
                dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                distance = math.sqrt(dx * dx + dy * dy) + 1e-9
                overlap = radius[i] + radius[j] - distance
                if overlap <= 0:
                    continue
                nx, ny = dx / distance, dy / distance
                closing = (velocity[i, 0] - velocity[j, 0]) * nx + (velocity[i, 1] - velocity[j, 1]) * ny
                mi, mj = radius[i] ** 2, radius[j] ** 2
                share = mj / (mi + mj)
                position[i, 0] += overlap * share * nx
                position[i, 1] += overlap * share * ny
                position[j, 0] -= overlap * (1 - share) * nx
                position[j, 1] -= overlap * (1 - share) * ny
                if closing < 0:
                    kick = (1 + bounce) * closing
                    velocity[i, 0] -= kick * share * nx
                    velocity[i, 1] -= kick * share * ny
                    velocity[j, 0] += kick * (1 - share) * nx
                    velocity[j, 1] += kick * (1 - share) * ny


def lowered(segment: np.ndarray, by: float) -> np.ndarray:
    """A segment (2, 2) moved down."""
    return segment + np.array([0.0, by])


def sample_motion(rng: np.random.Generator, aspect: float, rolls: np.ndarray, seconds: float) -> FlatMotion:
    """A random motion of len(rolls) bodies. aspect: the picture's width over its height. rolls: (N,) bool, round
    bodies. seconds: its length."""
    count = len(rolls)
    kind = str(rng.choice(KINDS, p=[0.2, 0.1, 0.2, 0.13, 0.2, 0.12, 0.05]))
    gravity = 9.81 / log_uniform(rng, 0.4, 4.0)
    bounce, drag = float(rng.uniform(0, 0.9)), float(rng.choice([0.0, rng.uniform(0, 0.5)]))
    radius = log_uniform(rng, 0.011, 0.2) * np.exp(rng.normal(0, 0.25 if rng.random() < 0.7 else 0.0, count))
    if rng.random() < 0.3:
        radius[:] = radius[0]
    position, velocity = rng.uniform(0.1, 0.9, (count, 2)) * [aspect, 1.0], rng.normal(0, 0.02, (count, 2))
    spin, release = rng.normal(0, 8, count) * (rng.random(count) < 0.8), np.zeros(count)
    floor = np.array([[-3.0, y := rng.uniform(0.75, 1.2)], [aspect + 3.0, y + rng.normal(0, 0.01)]])
    segments = [floor]
    rolls = rolls & (rng.random() < 0.9)
    top = floor[0, 1]
    if kind in ("throw", "carried"):
        side = float(rng.integers(2))
        position[:, 0] = rng.uniform(-0.15, 0.35, count) if side == 0 else aspect - rng.uniform(-0.15, 0.35, count)
        position[:, 1] = rng.uniform(0.2, 0.85, count)
        height = np.maximum(position[:, 1] - rng.uniform(-0.1, 0.6, count), 0.02)
        velocity[:, 1] = -np.sqrt(2 * gravity * height)
        flight = -velocity[:, 1] / gravity * rng.uniform(1.0, 2.5, count)
        velocity[:, 0] = (1 - 2 * side) * aspect * rng.uniform(0.2, 1.2, count) / flight
        if rng.random() < 0.5:
            release[:] = rng.uniform(0, 0.4) * seconds
        if rng.random() < 0.4:
            segments = [lowered(floor, 2.0)]
    elif kind == "drop":
        position[:, 1] = rng.uniform(-0.3, 0.4, count)
        release[:] = rng.uniform(0, 0.3, count) * seconds * (rng.random() < 0.6)
    elif kind == "incline":
        tilt = math.radians(rng.uniform(2, 48)) * float(rng.choice([-1, 1]))
        middle = np.array([aspect * rng.uniform(0.3, 0.7), rng.uniform(0.35, 0.75)])
        along = np.array([math.cos(tilt), math.sin(tilt)])
        ends = np.array([-rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.2)])
        segments = [lowered(floor, 0.3), middle + ends[:, None] * along]
        normal = np.array([math.sin(tilt), -math.cos(tilt)])
        down = 1.0 if tilt > 0 else -1.0
        place = np.sort(rng.uniform(0.05, 0.6, count)) * np.ptp(ends)
        start = segments[1][0 if tilt > 0 else 1]
        position = start + down * place[:, None] * along + normal * radius[:, None] * 1.001
        slow = rng.uniform(0.3, 1.0)  # friction
        gravity *= slow
        velocity = along * (rng.normal(0, 0.4, (count, 1)) * (rng.random() < 0.5))
        release[:] = rng.uniform(0, 0.5) * seconds * (rng.random() < 0.6)
    elif kind == "ledge":
        y = rng.uniform(0.15, 0.6)
        edge = aspect * rng.uniform(0.3, 0.7)
        segments = [floor, np.array([[-1.0, y], [edge, y + rng.normal(0, 0.01)]])]
        position[:, 0] = rng.uniform(-0.2, 0.8, count) * edge
        position[:, 1] = y - radius * 1.001
        velocity[:, 0] = log_uniform(rng, 0.2, 2.5)
        if rng.random() < 0.5:  # from the right
            segments = [floor, np.array([[aspect - edge, y], [aspect + 1.0, y]])]
            position[:, 0] = aspect - position[:, 0]
            velocity[:, 0] *= -1
    elif kind == "pucks":
        gravity = 0.0
        segments = [lowered(floor, 5.0)]
        aim = rng.uniform(0.25, 0.75, (count, 2)) * [aspect, 1.0]
        position = rng.uniform(-0.1, 1.1, (count, 2)) * [aspect, 1.0]
        velocity = (aim - position) * log_uniform(rng, 0.2, 3)
        velocity[rng.random(count) < 0.35] = 0.0
        if not velocity.any():
            velocity[0] = aim[0] - position[0]
        spin = rng.normal(0, 4, count) * (rng.random(count) < 0.8)
        drag = float(rng.uniform(0, 1))
        rolls = np.zeros(count, bool)
        if rng.random() < 0.3:
            release[0] = rng.uniform(0, 0.3) * seconds
    else:  # level
        top = rng.uniform(0.4, 0.95)
        segments = [np.array([[-3.0, top + rng.normal(0, 0.02)], [aspect + 3.0, top]])]
        position[:, 0] = np.linspace(0.1, 0.9, count) * aspect + rng.normal(0, 0.05, count)
        position[:, 1] = top - 1.2 * radius
        velocity[:, 0] = rng.normal(0, 0.8, count) * (rng.random(count) < 0.7)
        if not velocity.any():
            velocity[0, 0] = rng.normal(0, 0.8)
    lines = np.array(segments)
    steps = round(seconds * STEPS_PER_SECOND)
    positions, angles = np.empty((steps, count, 2)), np.empty((steps, count))
    integrate(
        position.astype(float),
        velocity.astype(float),
        spin.astype(float),
        radius,
        rolls,
        release,
        lines,
        gravity,
        drag,
        bounce,
        1 / STEPS_PER_SECOND,
        positions,
        angles,
    )
    if kind == "carried":  # by a hand along a smooth path, then put down
        way = np.linspace(0, 1, steps)[:, None, None]
        s = np.clip((way - 0.05) / rng.uniform(0.3, 0.9), 0, 1)
        goal = np.stack([rng.uniform(0.2, 0.8, count) * aspect, np.full(count, min(top, 0.95)) - radius], 1)
        positions[:] = positions[:1] + (s * s * (3 - 2 * s)) * (goal - positions[:1])
        angles[:] = angles[:1]
        release[:] = seconds * 0.9
    if kind == "throw" and rng.random() < 0.4:  # the hand swings before it lets go
        held = max(int(release[0] * STEPS_PER_SECOND), 1)
        back = np.linspace(1, 0, held)[:, None, None] ** 2 * rng.normal(0, 0.15, (1, 1, 2))
        positions[:held] += back
    return FlatMotion(position=positions, angle=angles, radius=radius, segments=lines, release=release, kind=kind)
