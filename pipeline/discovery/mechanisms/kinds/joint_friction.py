"""Dry friction of a joint (Coulomb): it does not depend on the speed, and holds at rest."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.joint(name).frictionloss += values["f"][0]


EFFECT = MechanismEffect(
    name="joint_friction",
    formula="tau = -f sign(v), holds at rest",
    parameters=(Parameter("f", "N m", low=0),),
    target=Target.JOINT,
    experiment="let it come to rest: dry friction takes the same angle of each swing, and stops it beside the middle",
    sizes=lambda place: {"f": place.torque},
    starts=lambda place: ({"f": np.array([0.1 * place.torque])},),
    edit=edit,
    linear="f",
)
