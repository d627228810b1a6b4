"""Sliding friction differs along two directions of the ground: brushed metal, a fabric.

Maximal dissipation within an elliptic cone of half axes mu (along the angle) and ratio mu (across it).
"""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values

LEAST_SLIP = 0.02  # m/s, below which friction fades


def force(values: Values, body: Body) -> np.ndarray:
    """What the elliptic cone's friction has over the round one of half axis mu."""
    slip, ratio, angle = body.slip, values["ratio"], values["angle"]
    c, s = np.cos(angle), np.sin(angle)
    along, across = c * slip[..., 0] + s * slip[..., 1], c * slip[..., 1] - s * slip[..., 0]
    least = LEAST_SLIP**2
    elliptic = np.sqrt(along**2 + (ratio * across) ** 2 + least)
    rounded = np.sqrt(along**2 + across**2 + least)
    limit = body.sliding_friction * body.normal_force
    f_along = -limit * along * (1 / elliptic - 1 / rounded)
    f_across = -limit * across * (ratio**2 / elliptic - 1 / rounded)
    return np.stack([c * f_along - s * f_across, s * f_along + c * f_across, 0 * f_along], -1)


EFFECT = EffectKind(
    name="anisotropic_friction",
    formula="friction mu N along the angle, ratio mu N across it",
    parameters=(
        Parameter("ratio", "-", low=0.02, high=50, scale=0.3, neutral=1.0),
        Parameter("angle", "rad", low=-1.6, high=1.6, scale=0.5),
    ),
    regimes=(Regime.SLIDING,),
    experiment="slide it in eight directions of the ground",
    force=force,
)
