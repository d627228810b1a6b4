"""Contact pulls a body towards what it touches, which increases the normal force until the contact ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Experiment
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene


def normal_force(values: Values, body: Body) -> np.ndarray:
    return values["force"]


def patch_force(values: Values, body: Body) -> np.ndarray:
    """Down, while the body touches what is below it."""
    pull = values["force"] * (body.normal_force > 0)
    return -pull[..., None] * np.array([0.0, 0.0, 1.0])


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    for name in objects:
        root.actuator.add("adhesion", name=f"adhesion_{name}", body=name, gain=values["force"], ctrlrange=[0, 1])
    key = root.find("key", "initial")
    key.ctrl = np.ones(len(root.actuator.adhesion))


def equals(effect: Mapping[str, Any], experiment: Experiment) -> frozenset[str]:
    """It presses as a larger weight does."""
    return frozenset({"clock_rate", "gravity_error", "length_scale"})


EFFECT = EffectKind(
    name="adhesion",
    formula="the normal force grows by F while in contact",
    parameters=(Parameter("force", "N", low=0, scale=1.0),),
    regimes=(Regime.IMPACT, Regime.SLIDING),
    experiment="slide it with a weight on top: friction of adhesion does not grow with the weight",
    normal_force=normal_force,
    edit=edit,
    patch_force=patch_force,
    discovery=DiscoveryRules(needs_known=("sliding_friction",), equals=equals),
    # in MuJoCo pucks hop, and adhere only while they touch the ground
    hiding=Hiding(lambda s, at: {"force": 0.1 * s * at.mass * 9.81}, scenarios=("puck",), engines=("events",)),
)
