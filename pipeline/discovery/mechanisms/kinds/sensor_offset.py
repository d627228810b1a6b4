"""Not physics: the sensor of a joint is off by a constant."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target
from pipeline.scene.effects.kind import Parameter

EFFECT = MechanismEffect(
    name="sensor_offset",
    formula="measured q = q + value",
    parameters=(Parameter("value", "rad"),),
    target=Target.JOINT,
    experiment="move it to a position that is known, such as a stop",
    sizes=lambda place: {"value": place.spread},
    starts=lambda place: ({"value": np.array([0.02 * place.spread])},),
    measured=lambda values, position: np.asarray(position + values["value"][0]),
    linear="value",
)
