"""Simulation of one scene by MuJoCo, with the states and contacts of all steps."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.errors import SimulationError
from pipeline.physics.effect_forces import ApplyForces, effect_forces
from pipeline.physics.object_states import object_bodies, object_states
from pipeline.physics.trace import FIRST_FIXED, GROUND, Contacts, Trace
from pipeline.scene.mjcf import FIXED_GROUP, scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import STEPS_PER_SECOND

#: Warnings of MuJoCo that the simulation is unstable, after which it resets the simulation by itself.
BAD_WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


def compile_xml(xml: str) -> mujoco.MjModel:
    """The compiled model. Raises SimulationError with the message of the compiler."""
    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise SimulationError(f"MuJoCo's compiler refuses the scene: {error}") from None


def simulate(scene: Scene, seconds: float = 1.0) -> Trace:
    """Simulate a scene with its effects for `seconds`. Raises SimulationError where the simulation becomes unstable."""
    return simulate_model(compile_xml(scene_xml(scene)), seconds, effect_forces(scene))


def simulate_model(model: mujoco.MjModel, seconds: float, forces: ApplyForces | None = None) -> Trace:
    """Simulate a model that was compiled from the MJCF of a scene, from its keyframe `initial`.

    forces is called before each step and writes forces that are not part of the model. Raises SimulationError where the
    simulation becomes unstable.
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    steps = round(seconds * STEPS_PER_SECOND)
    qpos, qvel = np.empty((steps + 1, model.nq)), np.empty((steps + 1, model.nv))
    rows: list[tuple[np.ndarray, ...]] = []
    for step in range(steps):
        qpos[step], qvel[step] = data.qpos, data.qvel
        if forces is not None:
            forces(model, data)
        mujoco.mj_step(model, data)
        if step == 0 or data.time < (step + 0.5) / STEPS_PER_SECOND:  # a later reset sets the time back
            _check(data, step)
        if data.ncon:
            rows.append(_contact_rows(model, data, step))
    qpos[steps], qvel[steps] = data.qpos, data.qvel
    if not (np.isfinite(qpos).all() and np.isfinite(qvel).all()):
        raise SimulationError("the simulation became unstable (non-finite state)")
    position, quaternion, velocity, spin = object_states(model, qpos, qvel)
    return Trace(STEPS_PER_SECOND, position, quaternion, velocity, spin, _contacts(model, rows))


def _check(data: mujoco.MjData, step: int) -> None:
    for warning in BAD_WARNINGS:
        if data.warning[warning].number:
            raise SimulationError(f"MuJoCo: {warning.name} at t={step / STEPS_PER_SECOND:.3f} s")
    if round(data.time * STEPS_PER_SECOND) != step + 1:
        raise SimulationError(f"MuJoCo reset the simulation at t={step / STEPS_PER_SECOND:.3f} s")


def _contact_rows(model: mujoco.MjModel, data: mujoco.MjData, step: int) -> tuple[np.ndarray, ...]:
    """Contacts of the last step: step, geoms (C, 2), position, distance, frame (C, 9), force in the frame (C, 6)."""
    contact, force = data.contact, np.empty((data.ncon, 6))
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force[i])
    steps = np.full(data.ncon, step)
    return (steps, contact.geom.copy(), contact.pos.copy(), contact.dist.copy(), contact.frame.copy(), force)


def _contacts(model: mujoco.MjModel, rows: list[tuple[np.ndarray, ...]]) -> Contacts:
    if not rows:
        index, vector = np.zeros(0, int), np.zeros((0, 3))
        return Contacts(
            step=index, first=index, second=index, position=vector, normal=vector, distance=np.zeros(0), force=vector
        )
    step, geom, position, distance, frame, force = (np.concatenate(column) for column in zip(*rows, strict=True))
    body = geom_bodies(model)[geom]
    frame = frame.reshape(-1, 3, 3)  # rows: normal from geom 0 to geom 1, two tangents
    world = np.einsum("ci,cij->cj", force[:, :3], frame)  # on geom 1
    swap = body[:, 0] <= GROUND  # ground and fixed bodies are always second
    first, second = np.where(swap[:, None], body[:, ::-1], body).T
    sign = np.where(swap, 1.0, -1.0)[:, None]
    return Contacts(
        step=step,
        first=first,
        second=second,
        position=position,
        normal=sign * frame[:, 0],
        distance=distance,
        force=sign * world,
    )


def geom_bodies(model: mujoco.MjModel) -> np.ndarray:
    """(G,) the index of each geom's body as `Contacts` has it."""
    number = np.full(model.nbody, GROUND)
    bodies = object_bodies(model, model.nbody - 1)
    number[bodies] = np.arange(len(bodies))
    body = number[model.geom_bodyid]
    fixed = np.flatnonzero((body == GROUND) & (model.geom_group == FIXED_GROUP))
    body[fixed] = FIRST_FIXED - np.arange(len(fixed))
    return body
