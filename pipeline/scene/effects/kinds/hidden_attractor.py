"""Something unseen and fixed attracts (or repels), as the inverse square of the distance."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

LEAST_DISTANCE = 0.02  # m: nearer, the force grows no more


def force(values: Values, body: Body) -> np.ndarray:
    away = values["position"] - body.position
    square = np.einsum("...i,...i->...", away, away) + LEAST_DISTANCE**2
    return (values["strength"] / (square * np.sqrt(square)))[..., None] * away


EFFECT = EffectKind(
    name="hidden_attractor",
    formula="F = k r / |r|^3 towards a fixed point",
    parameters=(Parameter("position", "m", length=3, scale=0.2), Parameter("strength", "N m^2", scale=0.1)),
    regimes=EVERYWHERE,
    experiment="hold a body at rest at several places and measure the force on it",
    force=force,
)
