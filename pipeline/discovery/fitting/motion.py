"""Integration of the motion along arcs, for many parameter sets at once.

In the air by the classical Runge-Kutta method. On the ground by Moreau's time stepping: Coulomb friction is an impulse
that at most stops the slip, so that sliding, rolling and resting need no case distinction and no stiff regularisation.

Shapes: P parameter sets, A arcs, K steps, n samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.discovery.tracks.stack import ArcStack
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EffectKind, Law


@dataclass(frozen=True)
class ActingEffect:
    """An effect with its parameters, each (P, A) or (P, A, 3). acts (A,) bool: on which arcs it acts."""

    kind: EffectKind
    values: dict[str, np.ndarray]
    acts: np.ndarray

    @cached_property
    def on_all(self) -> bool:
        """Whether it acts on all arcs."""
        return bool(self.acts.all())


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


def _total(laws: Sequence[tuple[ActingEffect, Law]], body: Body) -> np.ndarray:
    """Sum of what laws of effects give, (P, A, 3) or (P, A); () of no laws."""
    total = np.zeros(())
    for effect, law in laws:
        given = law(effect.values, body)
        if not effect.on_all:
            given = np.where(effect.acts[:, None] if given.ndim > 2 else effect.acts, given, 0.0)
        total = total + given
    return total


def _laws(effects: Sequence[ActingEffect], name: str) -> list[tuple[ActingEffect, Law]]:
    """The laws of that name that the effects have, but for the forces of blows."""
    named = [(e, getattr(e.kind, name)) for e in effects if name != "force" or e.kind.kick is None]
    return [(e, law) for e, law in named if law is not None]


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
    body.angular_velocity, body.step = spin, h
    gravity, mass = body.gravity, stack.mass[:, None]
    kicks, winds, forces = _kicks(stack, effects), _laws(effects, "air_velocity"), _laws(effects, "force")
    step = h[..., None]
    size = (*x.shape[:2], stack.steps + 1, 3)
    positions, velocities = np.empty(size), np.empty(size)
    positions[:, :, 0], velocities[:, :, 0] = x, v

    def acceleration(x: np.ndarray, v: np.ndarray, half_step: int) -> np.ndarray:
        body.time = stack.start + half_step / 2 * h
        body.position, body.velocity, body.others = x, v, stack.others[:, half_step]
        if winds:
            body.air_velocity = _total(winds, body)
        return gravity + _total(forces, body) / mass

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
    flat = np.array([1.0, 1.0, 0.0])
    x, v, spin = start[..., :3], start[..., 3:6] * flat, start[..., 6:9]
    shape = x.shape[:2]
    body = _body(stack, shape, stack.start)
    sliding = friction.sliding * (1 + start[..., 10])
    body.sliding_friction, body.step = sliding, h
    rolls = stack.radius > 0
    mass, radius, inertia = stack.mass, stack.radius, stack.inertia
    slip_mass = np.where(rolls, mass / 3.5, mass)  # of a ball's contact point: 1 / (1/m + r²/I)
    arm = np.where(rolls, radius / inertia, 0.0)
    weight = -mass * stack.gravity[:, 2]
    body.normal_force = resting = np.maximum(weight, 0) + np.zeros(shape)
    kicks, step = [(when, dv * flat) for when, dv in _kicks(stack, effects)], h[..., None]
    per_mass = flat / mass[:, None]
    fall, change_per_force = step * stack.gravity * flat, step * per_mass
    acceleration = np.zeros_like(v)
    size = (*shape, stack.steps + 1, 3)
    positions, velocities = np.empty(size), np.empty(size)
    spins = np.empty(size) if rolls.any() else np.broadcast_to(spin[:, :, None], size)
    positions[:, :, 0], velocities[:, :, 0] = x, v
    names = ("air_velocity", "ground_velocity", "force", "normal_force", "torque")
    winds, belts, forces, presses, torques = (_laws(effects, name) for name in names)
    for k in range(stack.steps):
        body.time = stack.start + (k + 0.5) * h
        body.position, body.velocity = x + step / 2 * v, v + step / 2 * acceleration
        body.angular_velocity, body.others = spin, stack.others[:, 2 * k + 1]
        after, normal = v + fall, resting
        if winds:
            body.air_velocity = _total(winds, body)
        if belts:
            body.ground_velocity = _total(belts, body)
        if forces:
            force = np.broadcast_to(_total(forces, body), v.shape)
            after = after + change_per_force * force
            normal = np.maximum(weight - force[..., 2], 0.0)
        if presses:
            normal = normal + _total(presses, body)
        body.normal_force = normal
        slip = after - body.ground_velocity
        if rolls.any():
            spins[:, :, k] = spin
            torque = -(friction.rolling * normal)[..., None] * _unit(spin * flat, 0.3)
            torque[..., 2] -= friction.torsional * normal * _unit(spin * (1 - flat), 0.3)[..., 2]
            torque = torque + _total(torques, body)
            spin = np.where(rolls[:, None], _slowed(spin, step * torque / inertia[:, None]), spin)
            slip[..., 0] -= spin[..., 1] * radius
            slip[..., 1] += spin[..., 0] * radius
        speed = np.sqrt(slip[..., 0] ** 2 + slip[..., 1] ** 2 + 1e-18)
        blow = np.minimum(sliding * normal * h, slip_mass * speed) / speed
        push = blow[..., None] * slip
        after = after - push * per_mass
        if rolls.any():
            spin[..., 0] -= arm * push[..., 1]
            spin[..., 1] += arm * push[..., 0]
        acceleration = (after - v) / step
        x = x + step / 2 * (v + after)
        v = after
        if kicks:
            x, v = _after_kicks(kicks, x, v, k * h, h)
        positions[:, :, k + 1], velocities[:, :, k + 1] = x, v
    if rolls.any():
        spins[:, :, stack.steps] = spin
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
