"""Not physics: the recording's clock runs fast (above 1) or slow."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target
from pipeline.scene.effects.kind import Parameter

EFFECT = MechanismEffect(
    name="clock_rate",
    formula="recorded time = ratio x true time",
    parameters=(Parameter("ratio", "-", low=0.2, high=5, neutral=1.0),),
    target=Target.WORLD,
    experiment="record a second clock",
    sizes=lambda place: {"ratio": 0.05},
    starts=lambda place: ({"ratio": np.array([1.005])},),
    clock=lambda values: float(values["ratio"][0]),
    linear="ratio",
)
