"""Where effects may act, with the sizes of the motion there."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target
from pipeline.discovery.mechanisms.log import Log, Quantity
from pipeline.discovery.mechanisms.mechanism import Joint, Mechanism

LEAST = 1e-6  # of a speed or force: what is slower stands still


def places_of(mechanism: Mechanism, log: Log) -> dict[Target, tuple[Place, ...]]:
    """What each kind of effect may act on: measured or driven joints, driven actuators, moving bodies, the world."""
    interval = float(np.median(np.concatenate([np.diff(c.time) for c in log.clips])))
    joints = tuple(_joint_place(mechanism, log, j, interval) for j in mechanism.joints)
    return {
        Target.JOINT: joints,
        Target.ACTUATOR: tuple(
            place for name in log.driven if (place := _actuator_place(mechanism, log, name, interval)).spread > LEAST
        ),
        Target.BODY: tuple(_body_place(mechanism, name) for name in mechanism.bodies),
        Target.WORLD: (Place(Target.WORLD, "", torque=float(np.linalg.norm(mechanism.model.opt.gravity))),),
    }


def may_act(kind: MechanismEffect, mechanism: Mechanism, log: Log, place: Place) -> bool:
    """Whether an effect could act at a place and be seen."""
    if (kind.measured is not None or kind.sensor_lag is not None) and place.name not in log.joints:
        return False
    return kind.may_act is None or kind.may_act(mechanism, log, place)


def motion(log: Log, joint: Joint) -> tuple[np.ndarray, float] | None:
    """All measured positions of a joint, and the root mean square of its velocity; None where it was not measured."""
    column = log.column(Quantity.JOINT, joint.name)
    if column is None:
        return None
    positions, squares = [], []
    for clip in log.clips:
        there = np.isfinite(clip.values[:, column])
        q, t = clip.values[there, column], clip.time[there]
        positions.append(q)
        squares.append((np.diff(q) / np.diff(t)) ** 2)
    every = np.concatenate(positions)
    return (every, float(np.sqrt(np.mean(np.concatenate(squares))))) if len(every) > 1 else None


def _joint_place(mechanism: Mechanism, log: Log, joint: Joint, interval: float) -> Place:
    model = mechanism.model
    inertia = float(model.dof_M0[joint.velocity])
    seen = motion(log, joint)
    if seen is None:
        q, speed = np.array([-0.5, 0.5]), 1.0
    else:
        q, speed = seen
    low, high = (float(v) for v in (q.min(), q.max()))
    speed = max(speed, LEAST)
    # An oscillation of this speed and spread has this acceleration; the weight is what a joint has to carry.
    torque = inertia * speed**2 * 3 / max(high - low, LEAST)
    return Place(
        Target.JOINT,
        joint.name,
        joint=model.joint(joint.name).id,
        slide=joint.slide,
        low=low,
        middle=float(np.median(q)),
        high=high,
        speed=speed,
        torque=max(torque, LEAST * inertia),
        inertia=inertia,
        interval=interval,
    )


def _actuator_place(mechanism: Mechanism, log: Log, name: str, interval: float) -> Place:
    column = mechanism.actuators.index(name)
    u = np.concatenate([c.controls[:, column] for c in log.clips])
    return Place(Target.ACTUATOR, name, low=float(u.min()), high=float(u.max()), interval=interval)


def _body_place(mechanism: Mechanism, name: str) -> Place:
    """A body; its length is that of the farthest corner of its geoms, and of what hangs on it."""
    model = mechanism.model
    body = model.body(name)
    reach = [float(np.linalg.norm(model.geom_pos[g]) + model.geom_rbound[g] / 2) for g in _geoms(model, body.id)]
    reach += [float(np.linalg.norm(model.body_pos[b])) for b in range(model.nbody) if model.body_parentid[b] == body.id]
    mass = float(model.body_subtreemass[body.id])
    return Place(
        Target.BODY,
        name,
        mass=max(mass, LEAST),
        length=max([*reach, float(np.linalg.norm(body.ipos))], default=0.1) or 0.1,
    )


def _geoms(model: mujoco.MjModel, body: int) -> range:
    first = int(model.body_geomadr[body])
    return range(first, first + int(model.body_geomnum[body]))
