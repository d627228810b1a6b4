"""The user's model with the effects found: MJCF that plain MuJoCo loads, and a program where MJCF cannot say one."""

from __future__ import annotations

import mujoco

from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.discovery.report.copied_code import CopiedCode, array_text

PROGRAM = '''"""Friction that MJCF cannot say: plain MuJoCo with augmented.xml beside this file.

    import mujoco, augmented_forces
    model = mujoco.MjModel.from_xml_path("augmented.xml")
    data = mujoco.MjData(model)
    augmented_forces.step(model, data)          # in place of mujoco.mj_step

Run by itself it simulates one second from the initial state.
"""

from pathlib import Path

import mujoco
import numpy as np

{functions}

#: Joint, dry friction that augmented.xml states, law, its numbers.
LAWS = [
{laws}
]


def before_step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Set each joint's dry friction to what it is at its present speed and load."""
    for joint, stated, law, values in LAWS:
        dof = model.joint(joint).dofadr[0]
        model.dof_frictionloss[dof] = stated + law(values, float(data.qvel[dof]), float(data.qfrc_actuator[dof]))


def step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """One time step."""
    before_step(model, data)
    mujoco.mj_step(model, data)


if __name__ == "__main__":
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("augmented.xml")))
    data = mujoco.MjData(model)
    while data.time < 1.0:
        step(model, data)
    print("positions after 1 s:", data.qpos)
'''


def augmented_document(mechanism: Mechanism, answer: Candidate, stated_steps: bool) -> mujoco.MjSpec:
    """The user's document with the calibrated numbers and the effects of a model.

    What the user's files are named by is made absolute, so that it loads from any folder.

    Args:
        mechanism: The user's model.
        answer: The model behind the verdict.
        stated_steps: Whether the model's own time steps explain the log; else the document has those that do.
    """
    out = answer.fit.model.document(mechanism.spec, answer.fit.theta)
    if not stated_steps:
        used = answer.problem.simulator.spec.option
        out.option.timestep, out.option.integrator = used.timestep, used.integrator
    folder = mechanism.path.resolve().parent
    if any(True for _ in (*out.meshes, *out.hfields, *out.skins)):
        out.compiler.meshdir = str(folder / out.compiler.meshdir)
    if any(True for _ in out.textures):
        out.compiler.texturedir = str(folder / out.compiler.texturedir)
    return out


def augmented_forces(answer: Candidate) -> str | None:
    """The program for the effects that MJCF cannot say; None where there are none."""
    model = answer.fit.model
    spec = model.document(answer.problem.mechanism.spec, answer.fit.theta)
    code, laws = CopiedCode(), []
    for a, values in zip(model.acting, model.values(answer.fit.theta), strict=True):
        if a.kind.friction is None:
            continue
        law = code.copy(a.kind.friction, a.kind.name)
        numbers = ", ".join(f"{k!r}: {array_text(v)}" for k, v in values.items())
        stated = float(spec.joint(a.place.name).frictionloss)
        laws.append(f"    ({a.place.name!r}, {stated!r}, {law}, {{{numbers}}}),")
    if not laws:
        return None
    return PROGRAM.replace("{functions}", code.text).replace("{laws}", "\n".join(laws))
