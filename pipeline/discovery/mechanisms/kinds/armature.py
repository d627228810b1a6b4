"""Inertia of a rotor, which turns with the joint."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.joint(name).armature += values["inertia"][0]


EFFECT = MechanismEffect(
    name="armature",
    formula="inertia of the joint + a",
    parameters=(Parameter("inertia", "kg m^2", low=0),),
    target=Target.JOINT,
    experiment="drive it without gravity: more inertia lowers the acceleration of every torque alike",
    sizes=lambda place: {"inertia": place.inertia},
    starts=lambda place: ({"inertia": np.array([0.1 * place.inertia])},),
    edit=edit,
    linear="inertia",
)
