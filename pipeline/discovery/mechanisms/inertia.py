"""The inertia of a body with a point mass on it."""

from __future__ import annotations

import mujoco
import numpy as np

AUTO, TRUE = (
    int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO),
    int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE),
)


def add_point_mass(spec: mujoco.MjSpec, name: str, mass: float, position: np.ndarray) -> None:
    """Write the inertia of a body and a point mass (kg, at (3,) m in the body's frame) into the document.

    The body's own inertia may follow from its geoms, so that the document is compiled first.
    """
    own, centre, inertia = _stated(spec, name)
    whole = own + mass
    both = (own * centre + mass * position) / whole
    tensor = inertia + own * _parallel(centre - both) + mass * _parallel(position - both)
    _state(spec.body(name), whole, both, tensor)


def _stated(spec: mujoco.MjSpec, name: str) -> tuple[float, np.ndarray, np.ndarray]:
    """What `_inertia` says of a body, in a document in which the inertia of any body may be written."""
    model = spec.compile()
    if int(spec.compiler.inertiafromgeom) == TRUE:  # which would ignore what is written
        spec.compiler.inertiafromgeom = AUTO
        for body in spec.bodies[1:]:
            _state(body, *_inertia(model, body.name))
    return _inertia(model, name)


def _inertia(model: mujoco.MjModel, name: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, kg, centre of mass (3,) m, and inertia about it (3, 3) kg m^2, in the body's frame."""
    body = model.body(name)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    axes = turn.reshape(3, 3)
    return float(body.mass[0]), np.array(body.ipos), axes @ np.diag(body.inertia) @ axes.T


def _parallel(arm: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass at (3,) about the origin (the parallel axis theorem)."""
    return np.asarray(arm @ arm * np.eye(3) - np.outer(arm, arm))


def _state(body: mujoco.MjsBody, mass: float, centre: np.ndarray, inertia: np.ndarray) -> None:
    body.explicitinertial = True
    body.mass, body.ipos = mass, centre
    moments, axes, turn = np.empty(3), np.empty(9), np.empty(4)
    mujoco.mju_eig3(moments, axes, turn, inertia.ravel())
    body.fullinertia = np.full(6, np.nan)  # not stated: its own axes are
    body.iquat, body.inertia = turn, moments


def scale_mass(spec: mujoco.MjSpec, name: str, mass: float) -> None:
    """Write a body's mass, kg, into the document; the body keeps its form, so that its inertia changes with it."""
    own, centre, inertia = _stated(spec, name)
    _state(spec.body(name), mass, centre, inertia * mass / own)
