"""Not physics: the sensor of a joint is off by a constant."""

from __future__ import annotations

import numpy as np

from pipeline.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def measured(values: Values, position: np.ndarray) -> np.ndarray:
    return np.asarray(position + values["value"][0])


EFFECT = MechanismEffect(
    name="sensor_offset",
    formula="measured q = q + value",
    parameters=(Parameter("value", "rad"),),
    target=Target.JOINT,
    experiment="move it to a position that is known, such as a stop",
    sizes=lambda place: {"value": place.spread},
    starts=lambda place: ({"value": np.array([0.02 * place.spread])},),
    measured=measured,
    linear="value",
)
