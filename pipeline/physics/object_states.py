"""Poses and velocities of a scene's objects in MuJoCo's states, whether their bodies are free or have joints."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.scene.mjcf import OBJECT_ORDER
from pipeline.scene.rotation import matrix_from_quaternion


def all_free(model: mujoco.MjModel) -> bool:
    """Whether all bodies that move are free; the state is then that of the objects, in order."""
    return bool((model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).all())


def object_bodies(model: mujoco.MjModel, objects: int) -> np.ndarray:
    """(N,) ids of the objects' bodies."""
    order = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TUPLE, OBJECT_ORDER)
    if order < 0:
        return np.arange(1, 1 + objects)
    first = model.tuple_adr[order]
    return model.tuple_objid[first : first + model.tuple_size[order]].copy()


def object_velocities(model: mujoco.MjModel, data: mujoco.MjData, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities of the centres (N, 3) m/s and angular velocities (N, 3) rad/s, in the world frame.

    data: after `mj_kinematics` and `mj_comPos`. bodies: (N,) ids.
    """
    if all_free(model):
        qvel = data.qvel.reshape(-1, 6)
        return qvel[:, :3], np.einsum("nij,nj->ni", data.xmat[bodies].reshape(-1, 3, 3), qvel[:, 3:])
    mujoco.mj_comVel(model, data)
    both = np.empty((len(bodies), 6))
    for row, body in zip(both, bodies, strict=True):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, row, 0)
    return both[:, 3:], both[:, :3]


def object_states(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, ...]:
    """Position (S, N, 3) m, quaternion (S, N, 4), velocity (S, N, 3) m/s and angular velocity (S, N, 3) rad/s of all
    objects in the world frame, from states (S, nq) and (S, nv)."""
    if all_free(model):
        qpos, qvel = qpos.reshape(len(qpos), -1, 7), qvel.reshape(len(qvel), -1, 6)
        quaternion = qpos[..., 3:]
        spin = np.einsum("...ij,...j->...i", matrix_from_quaternion(quaternion), qvel[..., 3:])
        return qpos[..., :3].copy(), quaternion.copy(), qvel[..., :3].copy(), spin
    data, bodies = mujoco.MjData(model), object_bodies(model, model.nbody - 1)
    rows = []
    for data.qpos[:], data.qvel[:] in zip(qpos, qvel, strict=True):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        rows.append((data.xpos[bodies], data.xquat[bodies], *object_velocities(model, data, bodies)))
    position, quaternion, velocity, spin = (np.stack(column) for column in zip(*rows, strict=True))
    return position, quaternion, velocity, spin
