"""Air that moves as a whole; it acts through its own drag, and other drags feel it too."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body, length
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def air_velocity(values: Values, body: Body) -> np.ndarray:
    return values["velocity"]


def force(values: Values, body: Body) -> np.ndarray:
    return -values["coefficient"][..., None] * length(body.airspeed) * body.airspeed


EFFECT = EffectKind(
    name="wind",
    formula="F = -k |v - w| (v - w)",
    parameters=(
        Parameter("velocity", "m/s", length=3, low=-30, high=30, scale=2.0),
        Parameter("coefficient", "kg/m", low=0, scale=0.01),
    ),
    regimes=EVERYWHERE,
    experiment="let a light body of the same shape go at rest: wind moves it",
    force=force,
    air_velocity=air_velocity,
)
