"""Not physics: the sensor of a joint is off by a factor."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target
from pipeline.scene.effects.kind import Parameter

EFFECT = MechanismEffect(
    name="sensor_scale",
    formula="measured q = value x q",
    parameters=(Parameter("value", "-", low=0.1, high=10, neutral=1.0),),
    target=Target.JOINT,
    experiment="move it by a whole turn, or by a length that is known",
    sizes=lambda place: {"value": 0.2},
    starts=lambda place: ({"value": np.array([1.02])},),
    measured=lambda values, position: np.asarray(position * values["value"][0]),
    linear="value",
)
