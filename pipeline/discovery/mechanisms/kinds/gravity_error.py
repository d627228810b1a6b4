"""Gravity is not what the model states."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    stated = np.array(spec.option.gravity)
    spec.option.gravity = stated / np.linalg.norm(stated) * values["gravity"][0]


EFFECT = MechanismEffect(
    name="gravity_error",
    formula="g is not what was stated",
    parameters=(Parameter("gravity", "m/s^2", low=0, high=100),),
    target=Target.WORLD,
    experiment="weigh a known mass there; or swing bodies of other inertia",
    sizes=lambda place: {"gravity": 0.2 * place.torque},
    starts=lambda place: ({"gravity": np.array([1.02 * place.torque])},),
    edit=edit,
    may_act=lambda mechanism, log, place: place.torque > 0,
    linear="gravity",
    neutral=lambda place: {"gravity": place.torque},
)
