"""The centre of mass is not the centre of the shape: a loaded die."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.scene.effects.kind import EffectKind, Parameter, Regime
from pipeline.scene.scene import Scene, half_extents


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    from pipeline.scene.solid import unit_inertia

    for obj in scene.objects:
        if obj.name in objects:
            inertia = obj.mass * unit_inertia(obj.shape, half_extents(obj)[None])[0]
            body = root.find("body", obj.name)
            body.add("inertial", pos=values["offset"], mass=obj.mass, diaginertia=inertia)


EFFECT = EffectKind(
    name="off_center_mass",
    formula="the centre of mass is at the offset from the shape's centre, in the body's frame",
    parameters=(Parameter("offset", "m", length=3, low=-1, high=1, scale=0.01),),
    regimes=(Regime.FLIGHT,),
    experiment="balance it on an edge, or throw it with much spin",
    edit=edit,
    needs=("orientation",),
)
