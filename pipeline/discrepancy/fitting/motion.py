"""Integration of the motion along arcs, for many parameter sets at once.

In the air by the classical Runge-Kutta method. On the ground by Moreau's time stepping: Coulomb friction is an impulse
that at most stops the slip, so that sliding, rolling and resting need no case distinction and no stiff regularisation.

Shapes: P parameter sets, A arcs, K steps, n samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.tracks.stack import ArcStack
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EffectKind, Law


@dataclass(frozen=True)
class ActingEffect:
    """An effect with its parameters, each (P, A) or (P, A, 3). acts (A,) bool: on which arcs it acts."""

    kind: EffectKind
    values: dict[str, np.ndarray]
    acts: np.ndarray


@dataclass(frozen=True)
class GroundFriction:
    """Friction of bodies on the ground, each (P, A): sliding; rolling and torsional, m."""

    sliding: np.ndarray
    rolling: np.ndarray
    torsional: np.ndarray


@dataclass(frozen=True)
class Nodes:
    """States at K + 1 nodes: position, velocity, angular velocity (P, A, K + 1, 3)."""

    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray


def predict(
    stack: ArcStack, effects: Sequence[ActingEffect], start: np.ndarray, friction: GroundFriction | None
) -> tuple[np.ndarray, np.ndarray, Nodes]:
    """The motion as a recording shows it.

    Args:
        stack: The arcs.
        effects: What acts on them.
        start: (P, A, 11) position, velocity and angular velocity of the centre of mass at the arc's start, and the
            relative errors of the arc's own length scale (lengths are measured from the arc's start) and friction.
        friction: Of bodies on the ground; None in the air.

    Returns:
        Positions (P, A, n, 3) m, spins (P, A, n, 3) rad/s, and the nodes of the integration.
    """
    ratio = _recording_ratio(stack, effects, 0)
    duration = stack.duration / ratio  # true time
    h = duration / stack.steps
    shown_start = start
    if stack.length_scale_sigma > 0:  # velocities as recorded, so that under gravity alone the problem is linear
        start = start.copy()
        start[..., 3:6] /= 1 + start[..., 9:10]
    nodes = _fly(stack, effects, start, h) if friction is None else _slide(stack, effects, start, h, friction)
    shown = _interpolate(stack, nodes.position, nodes.velocity, h)
    spins = _at_samples(stack, nodes.angular_velocity)
    for e in effects:
        if e.kind.mass_offset is not None:
            arm = np.einsum("anij,paj->pani", stack.rotation, e.kind.mass_offset(e.values))
            shown = shown - np.where(e.acts[:, None, None], arm, 0.0)
    if stack.length_scale_sigma > 0:
        first = shown_start[..., None, :3]
        shown = first + (shown - first) * (1 + start[..., None, 9:10])
    return shown * _recording_ratio(stack, effects, 1)[..., None, None], spins, nodes


def _recording_ratio(stack: ArcStack, effects: Sequence[ActingEffect], which: int) -> np.ndarray:
    """Recorded over true times (which = 0) or lengths (1), (P, A) or (1, A)."""
    ratio: np.ndarray = np.ones((1, len(stack)))
    for e in effects:
        if e.kind.recording is not None:
            ratio = e.kind.recording(e.values, ratio, ratio)[which]
    return ratio


def _body(stack: ArcStack, shape: tuple[int, int], start_time: np.ndarray) -> Body:
    """The bodies of the arcs. What changes from step to step is written later."""
    zero = np.zeros((*shape, 3))
    flat = np.zeros(shape)
    return Body(
        time=start_time,
        position=zero,
        velocity=zero,
        angular_velocity=zero,
        others=stack.others[:, 0],
        mass=stack.mass + flat,
        radius=stack.radius + flat,
        gravity=stack.gravity + zero,
        normal_force=flat,
        sliding_friction=stack.friction + flat,
        air_velocity=zero,
        ground_velocity=zero,
    )


def _total(laws: Iterable[tuple[ActingEffect, Law | None]], body: Body) -> np.ndarray:
    """Sum of vectors (P, A, 3) that laws of effects give; None gives nothing."""
    total = np.zeros(3)
    for effect, law in laws:
        if law is not None:
            total = total + np.where(effect.acts[:, None], law(effect.values, body), 0.0)
    return total


def _forces(effects: Sequence[ActingEffect], body: Body) -> np.ndarray:
    """Forces (P, A, 3) N but for blows, in air that moves as effects say."""
    if any(e.kind.air_velocity is not None for e in effects):
        body.air_velocity = _total(((e, e.kind.air_velocity) for e in effects), body)
    forces = ((e, e.kind.force) for e in effects if e.kind.kick is None)
    return np.zeros(body.velocity.shape) + _total(forces, body)


def _kicks(stack: ArcStack, effects: Sequence[ActingEffect]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Blows: time since the arc's start (P, A) s, and change of velocity (P, A, 3) m/s."""
    out = []
    for e in effects:
        if e.kind.kick is not None:
            when, momentum = e.kind.kick(e.values)
            out.append((when - stack.start, np.where(e.acts[:, None], momentum / stack.mass[:, None], 0.0)))
    return out


def _after_kicks(
    kicks: Sequence[tuple[np.ndarray, np.ndarray]], x: np.ndarray, v: np.ndarray, begin: np.ndarray, h: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """State at the end of a step that began at `begin`, after the blows during the step."""
    for when, dv in kicks:
        left = begin + h - when
        now = ((left > 0) & (left <= h))[..., None]
        x, v = x + np.where(now, dv * left[..., None], 0.0), v + np.where(now, dv, 0.0)
    return x, v


def _fly(stack: ArcStack, effects: Sequence[ActingEffect], start: np.ndarray, h: np.ndarray) -> Nodes:
    x, v, spin = start[..., :3], start[..., 3:6], start[..., 6:9]
    body = _body(stack, x.shape[:2], stack.start)
    body.angular_velocity = spin
    gravity, mass = body.gravity, stack.mass[:, None]
    kicks = _kicks(stack, effects)
    step = h[..., None]
    size = (*x.shape[:2], stack.steps + 1, 3)
    positions, velocities = np.empty(size), np.empty(size)
    positions[:, :, 0], velocities[:, :, 0] = x, v

    def acceleration(x: np.ndarray, v: np.ndarray, half_step: int) -> np.ndarray:
        body.time = stack.start + half_step / 2 * h
        body.position, body.velocity, body.others = x, v, stack.others[:, half_step]
        return gravity + _forces(effects, body) / mass

    for k in range(stack.steps):
        a1 = acceleration(x, v, 2 * k)
        v2 = v + step / 2 * a1
        a2 = acceleration(x + step / 2 * v, v2, 2 * k + 1)
        v3 = v + step / 2 * a2
        a3 = acceleration(x + step / 2 * v2, v3, 2 * k + 1)
        v4 = v + step * a3
        a4 = acceleration(x + step * v3, v4, 2 * k + 2)
        x, v = x + step / 6 * (v + 2 * v2 + 2 * v3 + v4), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        if kicks:
            x, v = _after_kicks(kicks, x, v, k * h, h)
        positions[:, :, k + 1], velocities[:, :, k + 1] = x, v
    return Nodes(positions, velocities, np.broadcast_to(spin[:, :, None], size))


def _slide(
    stack: ArcStack, effects: Sequence[ActingEffect], start: np.ndarray, h: np.ndarray, friction: GroundFriction
) -> Nodes:
    x, v, spin = start[..., :3].copy(), start[..., 3:6].copy(), start[..., 6:9].copy()
    v[..., 2] = 0.0
    shape = x.shape[:2]
    body = _body(stack, shape, stack.start)
    sliding = friction.sliding * (1 + start[..., 10])
    body.sliding_friction = sliding
    rolls = stack.radius > 0
    mass, radius = stack.mass, stack.radius
    inertia = stack.inertia
    slip_mass = np.where(rolls, mass / 3.5, mass)  # of a ball's contact point: 1 / (1/m + r²/I)
    weight = -mass * stack.gravity[:, 2]
    body.normal_force = np.maximum(weight, 0) + np.zeros(shape)
    kicks, step = _kicks(stack, effects), h[..., None]
    flat = np.array([1.0, 1.0, 0.0])
    acceleration = np.zeros_like(v)
    size = (*shape, stack.steps + 1, 3)
    positions, velocities, spins = np.empty(size), np.empty(size), np.empty(size)
    positions[:, :, 0], velocities[:, :, 0], spins[:, :, 0] = x, v, spin
    belts = [e for e in effects if e.kind.ground_velocity is not None]
    presses = [e for e in effects if e.kind.normal_force is not None]
    torques = [e for e in effects if e.kind.torque is not None]
    for k in range(stack.steps):
        body.time = stack.start + (k + 0.5) * h
        body.position, body.velocity = x + step / 2 * v, v + step / 2 * acceleration
        body.angular_velocity, body.others = spin, stack.others[:, 2 * k + 1]
        if belts:
            body.ground_velocity = _total(((e, e.kind.ground_velocity) for e in belts), body)
        force = _forces(effects, body)
        normal = np.maximum(weight - force[..., 2], 0.0)
        for e in presses:
            assert e.kind.normal_force is not None
            normal = normal + np.where(e.acts, e.kind.normal_force(e.values, body), 0.0)
        body.normal_force = normal
        after = v + step * (stack.gravity + force / mass[:, None]) * flat
        torque = -(friction.rolling * normal)[..., None] * _unit(spin * flat, 0.3)
        torque[..., 2] -= friction.torsional * normal * _unit(spin * (1 - flat), 0.3)[..., 2]
        for e in torques:
            assert e.kind.torque is not None
            torque = torque + np.where(e.acts[:, None], e.kind.torque(e.values, body), 0.0)
        turned = np.where(rolls[:, None], _slowed(spin, step * torque / inertia[:, None]), spin)
        slip = after - body.ground_velocity
        slip[..., 0] -= turned[..., 1] * radius
        slip[..., 1] += turned[..., 0] * radius
        speed = np.sqrt(slip[..., 0] ** 2 + slip[..., 1] ** 2 + 1e-18)
        blow = np.minimum(sliding * normal * h, slip_mass * speed) / speed
        push = -blow[..., None] * slip * flat
        after = after + push / mass[:, None]
        arm = np.where(rolls, radius / inertia, 0.0)
        spin = turned.copy()
        spin[..., 0] += arm * push[..., 1]
        spin[..., 1] -= arm * push[..., 0]
        acceleration = (after - v) / step
        x = x + step / 2 * (v + after)
        v = after
        if kicks:
            x, v = _after_kicks([(w, dv * flat) for w, dv in kicks], x, v, k * h, h)
        positions[:, :, k + 1], velocities[:, :, k + 1], spins[:, :, k + 1] = x, v, spin
    return Nodes(positions, velocities, spins)


def _unit(vectors: np.ndarray, least: float) -> np.ndarray:
    return vectors / np.sqrt((vectors * vectors).sum(-1, keepdims=True) + least * least)


def _slowed(spin: np.ndarray, change: np.ndarray) -> np.ndarray:
    """spin + change by friction, which reverses no component."""
    after = spin + change
    return np.where(spin * after < 0, np.where(np.abs(change) > np.abs(spin), 0.0, after), after)


def _interpolate(stack: ArcStack, x: np.ndarray, v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Cubic Hermite interpolation of the nodes at the samples, (P, A, n, 3)."""
    node, u = _sample_places(stack)
    rows = np.arange(len(stack))[:, None]
    x0, x1, v0, v1 = x[:, rows, node], x[:, rows, node + 1], v[:, rows, node], v[:, rows, node + 1]
    u = u[None, ..., None]
    step = np.broadcast_to(h, x.shape[:2])[..., None, None]
    return (
        (1 + 2 * u) * (1 - u) ** 2 * x0 + u**2 * (3 - 2 * u) * x1 + step * (u * (1 - u) ** 2 * v0 - u**2 * (1 - u) * v1)
    )


def _at_samples(stack: ArcStack, values: np.ndarray) -> np.ndarray:
    """Linear interpolation of the nodes' values at the samples, (P, A, n, 3)."""
    node, u = _sample_places(stack)
    rows = np.arange(len(stack))[:, None]
    return (1 - u[..., None]) * values[:, rows, node] + u[..., None] * values[:, rows, node + 1]


def _sample_places(stack: ArcStack) -> tuple[np.ndarray, np.ndarray]:
    """The node before each sample (A, n), and the sample's place between it and the next one, 0 to 1."""
    place = stack.time / np.maximum(stack.duration, 1e-12)[:, None] * stack.steps
    node = np.minimum(place.astype(int), stack.steps - 1)
    return node, place - node
