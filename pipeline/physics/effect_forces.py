"""The forces of those effects that MuJoCo's elements cannot say, written into a running simulation.

`augmented_forces.py` (`forces_file.py`) has the same laws for people without this package.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from pipeline.physics.object_states import object_bodies, object_velocities
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.text import effect_kind
from pipeline.scene.mjcf_effects import effects_outside_mjcf, needs_contacts
from pipeline.scene.scene import Effect, Scene, half_extents

CHATTER_STEPS = 16  # a body that slides at 3 m/s hops by 5 mm, for 15 steps of 1/240 s
IMPACT = 0.3  # m/s: a larger change in a step is an impact
ApplyForces = Callable[[mujoco.MjModel, mujoco.MjData], None]


@dataclass(frozen=True)
class AppliedEffect:
    """An effect of B scenes with its parameters (B, 1) and (B, 1, 3). acts (N,) bool: the objects on which it acts."""

    kind: EffectKind
    values: dict[str, np.ndarray]
    acts: np.ndarray


def with_force(kind: EffectKind) -> bool:
    """Whether the effect is a force, also where MuJoCo has it, or moves the ground; for engines without effects."""
    return kind.force is not None or moves_ground(kind)


def moves_ground(kind: EffectKind) -> bool:
    """Whether the effect moves the ground's surface, which forces of other effects may depend on."""
    return kind.ground_velocity is not None


def chosen_effects(scenes: Sequence[Scene], which: Callable[[EffectKind], bool]) -> list[AppliedEffect]:
    """The effects of B scenes whose kind is wanted. The scenes share their effects' names and objects, in order."""
    names = [[(e.name, e.objects, e.only) for e in s.effects] for s in scenes]
    assert all(n == names[0] for n in names), "scenes of one batch share their effects' names and where they act"
    out = []
    for i, effect in enumerate(scenes[0].effects):
        kind = effect_kind(effect)
        if which(kind):
            out.append(AppliedEffect(kind, _stacked([s.effects[i] for s in scenes]), _acts(effect, scenes[0])))
    return out


def _stacked(effects: Sequence[Effect]) -> dict[str, np.ndarray]:
    rows: dict[str, list[Any]] = {name: [e.values[name] for e in effects] for name, _ in effects[0].parameters}
    return {name: np.array(row, float)[:, None] for name, row in rows.items()}


def _acts(effect: Effect, scene: Scene) -> np.ndarray:
    return np.array([effect.objects is None or o.name in effect.objects for o in scene.objects])


def total_force(effects: Sequence[AppliedEffect], body: Body) -> np.ndarray:
    """The sum of the effects' forces on bodies of leading shape (B, N), (B, N, 3) N."""
    body.air_velocity, body.ground_velocity = np.zeros_like(body.velocity), np.zeros_like(body.velocity)
    for e in effects:
        if e.kind.air_velocity is not None:
            body.air_velocity = body.air_velocity + e.kind.air_velocity(e.values, body) * e.acts[:, None]
        if e.kind.ground_velocity is not None:
            body.ground_velocity = body.ground_velocity + e.kind.ground_velocity(e.values, body) * e.acts[:, None]
    force = np.zeros_like(body.position)
    for e in effects:
        if e.kind.force is not None:
            force += e.kind.force(e.values, body) * e.acts[:, None]
    return force


def total_torque(effects: Sequence[AppliedEffect], body: Body) -> np.ndarray:
    """The sum of the effects' torques on bodies as `total_force` has left them, (B, N, 3) N m."""
    torque = np.zeros_like(body.position)
    for e in effects:
        if e.kind.torque is not None:
            torque += e.kind.torque(e.values, body) * e.acts[:, None]
    return torque


def other_centres(position: np.ndarray) -> np.ndarray:
    """For each object the positions of the others, (..., N, N - 1, 3), from positions (..., N, 3)."""
    n = position.shape[-2]
    index = np.array([[j for j in range(n) if j != i] for i in range(n)], int).reshape(n, max(n - 1, 0))
    return position[..., index, :]


def resting_body(scenes: Sequence[Scene]) -> Body:
    """The bodies of B scenes, leading shape (B, N), with what does not change during a run; the rest is zero."""
    shape = (len(scenes), len(scenes[0].objects))
    zero = np.zeros((*shape, 3))
    mass = np.array([[o.mass for o in s.objects] for s in scenes])
    radius = np.array([[0.0 if o.shape == "mesh" else half_extents(o)[2] for o in s.objects] for s in scenes])
    friction = np.array([[o.sliding_friction for o in s.objects] for s in scenes])
    gravity = np.array([s.gravity for s in scenes])[:, None] + zero
    return Body(
        time=np.zeros(shape),
        position=zero,
        velocity=zero,
        angular_velocity=zero,
        others=other_centres(zero),
        mass=mass,
        radius=radius,
        gravity=gravity,
        normal_force=np.zeros(shape),
        sliding_friction=friction,
        air_velocity=zero,
        ground_velocity=zero,
    )


def forces_outside_mjcf(scene: Scene) -> list[AppliedEffect]:
    """The effects of a scene, of which those that its MJCF has are no forces but may move the air or the ground.

    Empty where the MJCF has them all.
    """
    outside, effects = effects_outside_mjcf(scene), chosen_effects([scene], lambda _: True)
    if not outside:
        return []
    kinds = [
        replace(e.kind, force=e.kind.force or e.kind.patch_force)
        if i in outside
        else replace(e.kind, force=None, torque=None)
        for i, e in enumerate(effects)
    ]
    return [replace(e, kind=kind) for e, kind in zip(effects, kinds, strict=True)]


def effect_forces(scene: Scene) -> ApplyForces | None:
    """A function that writes the forces of a scene's effects before each step; None where there are none."""
    effects = forces_outside_mjcf(scene)
    if not effects or not scene.objects:
        return None
    constant = resting_body([scene])
    in_contact = any(needs_contacts(e.kind) for e in effects)
    normal, halfway = RecentNormalForce(), HalfwayVelocity()

    def apply(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        half_step = model.opt.timestep / 2 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 0.0
        ends = object_bodies(model, len(scene.objects))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        velocity, spin = object_velocities(model, data, ends)
        start = data.xipos[ends]
        velocity = velocity + np.cross(spin, start - data.xpos[ends])
        if half_step:  # else as MuJoCo's default method takes forces
            velocity = halfway.after(velocity)
        position = start + half_step * velocity
        pressed = constant.normal_force
        if in_contact:
            pressed = normal.after(ground_forces(model, data, ends)[None])
        body = replace(
            constant,
            time=np.full(constant.time.shape, data.time + half_step),
            position=position[None],
            velocity=velocity[None],
            angular_velocity=spin[None],
            others=other_centres(position)[None],
            normal_force=pressed,
        )
        data.xfrc_applied[ends, :3] = total_force(effects, body)[0]
        data.xfrc_applied[ends, 3:] = total_torque(effects, body)[0]

    return apply


class HalfwayVelocity:
    """Velocities halfway through the coming step, extrapolated from this step and the last one.

    At the start of a step a falling body is half a step too slow: 1 % of drag.
    """

    def __init__(self) -> None:
        self._last: np.ndarray | None = None

    def after(self, velocity: np.ndarray) -> np.ndarray:
        """The velocities (..., 3) m/s, from those at the start of the step; an impact is not extrapolated."""
        change = np.zeros_like(velocity) if self._last is None else velocity - self._last
        self._last = velocity.copy()
        struck = np.linalg.norm(change, axis=-1, keepdims=True) > IMPACT
        return velocity + np.where(struck, 0.0, change / 2)


class RecentNormalForce:
    """Mean normal force over the last few steps.

    MuJoCo's bodies chatter: they touch the ground in some steps and not in others, where a real body would rest.
    """

    def __init__(self) -> None:
        self._recent: deque[np.ndarray] = deque(maxlen=CHATTER_STEPS)

    def after(self, last: np.ndarray) -> np.ndarray:
        """The mean over the forces of the last step, (...) N, and of steps before."""
        self._recent.append(last)
        return np.mean(self._recent, axis=0)


def ground_forces(model: mujoco.MjModel, data: mujoco.MjData, bodies: np.ndarray) -> np.ndarray:
    """The ground's normal force on each object in the last step, (N,) N. bodies: (N,) ids of the objects' bodies."""
    out, force = np.zeros(model.nbody), np.zeros(6)
    for i in range(data.ncon):
        first, second = model.geom_bodyid[data.contact.geom[i]]
        if min(first, second) == 0:
            mujoco.mj_contactForce(model, data, i, force)
            out[max(first, second)] += force[0]
    return out[bodies]
