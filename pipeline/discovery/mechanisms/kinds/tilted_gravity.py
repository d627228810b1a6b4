"""The base is tilted: gravity is not along the stated direction."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter
from pipeline.scene.effects.kinds.tilted_gravity import tilted


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.option.gravity = tilted(np.array(spec.option.gravity), np.array(values["tilt"]))


EFFECT = MechanismEffect(
    name="tilted_gravity",
    formula="g is turned by the tilt about x, then about y",
    parameters=(Parameter("tilt", "rad", length=2, low=-1.5, high=1.5),),
    target=Target.WORLD,
    experiment="put a level on the base",
    sizes=lambda place: {"tilt": 0.1},
    starts=lambda place: ({"tilt": np.array([0.02, 0.0])}, {"tilt": np.array([0.0, 0.02])}),
    edit=edit,
    may_act=lambda mechanism, log, place: place.torque > 0,
    linear="tilt",
)
