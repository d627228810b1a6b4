"""A torque against rolling, proportional to the normal force; it adds to the object's rolling friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body, direction
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene

LEAST_SPIN = 0.3  # rad/s, below which the torque fades


def torque(values: Values, body: Body) -> np.ndarray:
    rolling = body.angular_velocity * np.array([1.0, 1.0, 0.0])
    return -(values["coefficient"] * body.normal_force)[..., None] * direction(rolling, LEAST_SPIN)


def rolling_friction(values: Values) -> np.ndarray:
    return values["coefficient"]


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    for name in objects:
        geom = root.find("geom", name)
        geom.friction = geom.friction + np.array([0.0, 0.0, values["coefficient"]])


EFFECT = EffectKind(
    name="rolling_resistance",
    formula="torque = -c N w_t / |w_t|",
    parameters=(Parameter("coefficient", "m", low=0, scale=0.002),),
    regimes=(Regime.ROLLING, Regime.SLIDING),
    experiment="let it roll at two speeds: this slows it alike, viscous friction in proportion to the speed",
    torque=torque,
    rolling_friction=rolling_friction,
    edit=edit,
    discovery=DiscoveryRules(
        needs=(Need.GROUND_BALL,), needs_known=("rolling_friction",), scene_parameter="rolling_friction"
    ),
    hiding=Hiding(
        lambda s, at: {"coefficient": 0.01 * s * at.radius}, scenarios=("roll",), engines=("mujoco", "events")
    ),
)
