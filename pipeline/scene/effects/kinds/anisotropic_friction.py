"""Sliding friction differs along two directions of the ground: brushed metal, a fabric.

Maximal dissipation within an elliptic cone of half axes mu (along the angle) and ratio mu (across it).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Numbers, Observed, Start
from pipeline.scene.effects.hiding import Hiding, Setting
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values

LEAST_SLIP = 0.02  # m/s, below which friction fades


def force(values: Values, body: Body) -> np.ndarray:
    """The friction of the elliptic cone minus that of the round one of half axis mu."""
    slip, ratio, c, s = body.slip, values["ratio"], np.cos(values["angle"]), np.sin(values["angle"])
    along, across = c * slip[..., 0] + s * slip[..., 1], c * slip[..., 1] - s * slip[..., 0]
    elliptic = np.sqrt(along**2 + (ratio * across) ** 2 + LEAST_SLIP**2)
    rounded = np.sqrt(along**2 + across**2 + LEAST_SLIP**2)
    limit = body.sliding_friction * body.normal_force
    f_along = -limit * along * (1 / elliptic - 1 / rounded)
    f_across = -limit * across * (ratio**2 / elliptic - 1 / rounded)
    return np.stack([c * f_along - s * f_across, s * f_along + c * f_across, 0 * f_along], -1)


def starts(observed: Observed) -> list[Start]:
    """At four angles: without anisotropy the angle has no effect."""
    angles = (-np.pi / 4, 0.0, np.pi / 4, np.pi / 2)
    return [Start(np.array([1.0, a]), np.array([[-0.1, 0.0]])) for a in angles]


def canonical(values: Numbers, errors: Numbers, fit: Sequence[str]) -> tuple[Numbers, Numbers]:
    """The description with a ratio up to 1, where the sliding friction mu is free.

    mu along an angle and ratio mu across it is the same as mu' = ratio mu along the perpendicular direction and
    mu' / ratio across it.
    """
    ratio, angle, error = values["ratio"], values["angle"], errors["ratio"]
    assert isinstance(ratio, float) and isinstance(angle, float) and isinstance(error, float)
    if "sliding_friction" not in fit or ratio <= 1:
        return values, errors
    turned = float(angle - np.sign(angle or 1.0) * np.pi / 2)
    return {"ratio": 1 / ratio, "angle": turned}, {**errors, "ratio": error / ratio**2}


def hidden_values(s: float, at: Setting) -> dict[str, Any]:
    return {"ratio": 1 - 0.05 * s, "angle": float(np.arctan(at.across[1] / at.across[0]))}


EFFECT = EffectKind(
    name="anisotropic_friction",
    formula="friction mu N along the angle, ratio mu N across it",
    parameters=(
        Parameter("ratio", "-", low=0.02, high=50, scale=0.3, neutral=1.0),
        Parameter("angle", "rad", low=-1.6, high=1.6, scale=0.5, period=np.pi),
    ),
    regimes=(Regime.SLIDING,),
    experiment="slide it in eight directions of the ground",
    force=force,
    discovery=DiscoveryRules(starts=starts, canonical=canonical),
    hiding=Hiding(hidden_values, largest=16.0, scenarios=("puck",), engines=("mujoco", "events")),
)
