"""A torque against spinning about the contact's normal; it adds to MuJoCo's own torsional friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body, direction
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import GROUNDED, EffectKind, Parameter, Values
from pipeline.scene.scene import Scene

LEAST_SPIN = 0.3  # rad/s, below which the torque fades


def torque(values: Values, body: Body) -> np.ndarray:
    spinning = body.angular_velocity * np.array([0.0, 0.0, 1.0])
    return -(values["coefficient"] * body.normal_force)[..., None] * direction(spinning, LEAST_SPIN)


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    for name in objects:
        geom = root.find("geom", name)
        geom.friction = geom.friction + np.array([0.0, values["coefficient"], 0.0])


EFFECT = EffectKind(
    name="spin_friction",
    formula="torque = -c N w_n / |w_n|",
    parameters=(Parameter("coefficient", "m", low=0, scale=0.005),),
    regimes=GROUNDED,
    experiment="spin it on the spot, with a mark on it",
    torque=torque,
    edit=edit,
    discovery=DiscoveryRules(needs=(Need.GROUND_SPIN,)),
    hiding=Hiding(
        lambda s, at: {"coefficient": 0.05 * s * at.radius},
        largest=10.0,
        scenarios=("spin",),
        engines=("mujoco",),
        shows_in_spin=True,
    ),
)
