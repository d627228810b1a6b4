"""The true control is a multiple of the stated one: a wrong gear or motor constant."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.actuator(name).gainprm[:3] *= values["ratio"][0]


EFFECT = MechanismEffect(
    name="actuator_gain",
    formula="u = ratio x stated u",
    parameters=(Parameter("ratio", "-", low=-5, high=5, neutral=1.0),),
    target=Target.ACTUATOR,
    experiment="add a known payload: its weight tells the true force of the drive",
    sizes=lambda place: {"ratio": 0.5},
    starts=lambda place: ({"ratio": np.array([1.05])},),
    edit=edit,
    linear="ratio",
)
