"""The recording's frame rotates about z: Coriolis and centrifugal forces."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def force(values: Values, body: Body) -> np.ndarray:
    """-2 m W x v - m W x (W x r), W along z through the origin."""
    rate, v, r = values["angular_velocity"], body.velocity, body.position
    x = 2 * rate * v[..., 1] + rate**2 * r[..., 0]
    y = -2 * rate * v[..., 0] + rate**2 * r[..., 1]
    return body.mass[..., None] * np.stack([x, y, 0 * x], -1)


EFFECT = EffectKind(
    name="rotating_frame",
    formula="F = -2 m W x v - m W x (W x r)",
    parameters=(Parameter("angular_velocity", "rad/s", low=-50, high=50, scale=0.2),),
    regimes=EVERYWHERE,
    experiment="throw in opposite directions: Coriolis forces turn to the same hand",
    force=force,
    discovery=DiscoveryRules(needs=(Need.DIRECTIONS,)),
    hiding=Hiding(lambda s, at: {"angular_velocity": 0.05 * s * at.sign}),
)
