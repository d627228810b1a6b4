"""Not physics: the sensor of a joint shows the past."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target
from pipeline.scene.effects.kind import Parameter

EFFECT = MechanismEffect(
    name="sensor_delay",
    formula="measured q(t) = q(t - value)",
    parameters=(Parameter("value", "s", low=0, high=1),),
    target=Target.JOINT,
    experiment="compare with a second sensor at high speed",
    sizes=lambda place: {"value": 3 * place.interval},
    starts=lambda place: ({"value": np.array([place.interval])},),
    sensor_lag=lambda values: float(values["value"][0]),
    linear="value",
)
