"""Dry friction of a joint (Coulomb): it does not depend on the speed, and holds at rest."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.joint(name).frictionloss += values["f"][0]


def sizes(place: Place) -> dict[str, float]:
    return {"f": place.torque}


EFFECT = MechanismEffect(
    name="joint_friction",
    formula="tau = -f sign(v), holds at rest",
    parameters=(Parameter("f", "N m", low=0),),
    target=Target.JOINT,
    experiment="let it come to rest: dry friction takes the same angle of each swing, and stops it beside the middle",
    sizes=sizes,
    starts=lambda place: ({"f": np.array([0.1 * sizes(place)["f"]])},),
    edit=edit,
    linear="f",
)
