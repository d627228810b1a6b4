"""The centre of mass is not the centre of the shape: a loaded die."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.hiding import Hiding, Setting
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene


def mass_offset(values: Values) -> np.ndarray:
    return values["offset"]


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    from pipeline.scene.solid import principal_moments

    for obj in scene.objects:
        if obj.name in objects:
            body = root.find("body", obj.name)
            body.add("inertial", pos=values["offset"], mass=obj.mass, diaginertia=principal_moments(obj))


def hidden_values(s: float, at: Setting) -> dict[str, Any]:
    return {"offset": tuple(0.02 * s * at.radius * at.direction)}


EFFECT = EffectKind(
    name="off_center_mass",
    formula="the centre of mass is at the offset from the shape's centre, in the body's frame",
    parameters=(Parameter("offset", "m", length=3, low=-1, high=1, scale=0.01),),
    regimes=(Regime.FLIGHT,),
    experiment="balance it on an edge, or throw it with much spin",
    mass_offset=mass_offset,
    edit=edit,
    discovery=DiscoveryRules(needs=(Need.ORIENTATION,)),
    hiding=Hiding(hidden_values, scenarios=("cube",), engines=("mujoco",)),
)
