"""The user's model: an MJCF file as a document that is edited, and compiled, with its joints, actuators and bodies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.mjcf_files import check_mjcf
from pipeline.errors import SceneError

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
MOST_VELOCITIES = 200  # degrees of freedom: each is estimated for each clip


@dataclass(frozen=True)
class Joint:
    """A joint of one degree of freedom.

    Attributes:
        name: As in the MJCF.
        slide: Whether it slides; else it turns.
        position: Index in qpos.
        velocity: Index in qvel.
        body: Index of the body that it moves.
    """

    name: str
    slide: bool
    position: int
    velocity: int
    body: int

    @property
    def unit(self) -> str:
        """Of its position."""
        return "m" if self.slide else "rad"


@dataclass(frozen=True)
class Mechanism:
    """A model that was read.

    Attributes:
        path: Where it is from.
        spec: The document as the user wrote it. It is never changed: edits are made on copies.
        physics: The same without pictures, which are compiled again for each change of a number.
        model: `physics`, compiled.
        joints: Its joints of one degree of freedom.
        actuators: Names; an actuator without one is `actuator_<index>`.
    """

    path: Path
    spec: mujoco.MjSpec
    physics: mujoco.MjSpec
    model: mujoco.MjModel
    joints: tuple[Joint, ...]
    actuators: tuple[str, ...]

    def joint(self, name: str) -> Joint:
        """The joint of that name."""
        return next(j for j in self.joints if j.name == name)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that can move."""
        m = self.model
        moving = [b for b in range(1, m.nbody) if m.body_weldid[b] != 0]
        return tuple(name for b in moving if (name := m.body(b).name))

    @property
    def rest(self) -> np.ndarray:
        """The configuration in which it begins, (nq,): of the first keyframe, else the model's own."""
        return np.array(self.model.key_qpos[0] if self.model.nkey else self.model.qpos0)


def read_mechanism(path: Path) -> Mechanism:
    """The model of an MJCF file. Nothing in it is executed.

    Raises SceneError in one line for a file that is missing, damaged, too large, that names files outside of its
    folder, or that MuJoCo does not compile.
    """
    check_mjcf(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        physics = without_pictures(spec)
        model = physics.compile()
    except (ValueError, mujoco.FatalError, MemoryError, TypeError) as problem:
        raise SceneError(f"{path}: MuJoCo cannot compile it: {' '.join(str(problem).split())}") from None
    if model.nv == 0:
        raise SceneError(f"{path}: no joint: nothing in the model can move")
    if model.nv > MOST_VELOCITIES:
        raise SceneError(f"{path} has {model.nv} degrees of freedom; at most {MOST_VELOCITIES} are estimated")
    joints = []
    for k in range(model.njnt):
        kind, name = int(model.jnt_type[k]), model.joint(k).name
        if kind in (HINGE, SLIDE) and name:
            slide = kind == SLIDE
            joints.append(
                Joint(name, slide, int(model.jnt_qposadr[k]), int(model.jnt_dofadr[k]), int(model.jnt_bodyid[k]))
            )
    actuators = tuple(model.actuator(k).name or f"actuator_{k}" for k in range(model.nu))
    return Mechanism(path, spec, physics, model, tuple(joints), actuators)


def without_pictures(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy without textures, materials and skins, whose compilation would take most of the time."""
    out = spec.copy()
    for geom in out.geoms:
        geom.material = ""
    for site in out.sites:
        site.material = ""
    for tendon in out.tendons:
        tendon.material = ""
    for element in (*out.skins, *out.materials, *out.textures):
        out.delete(element)
    return out
