"""Something unseen and fixed stands in the way: a sphere of radius `size`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.scene.effects.kind import EffectKind, Parameter, Regime
from pipeline.scene.scene import Scene


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    number = sum(geom.name is not None and geom.name.startswith("hidden_obstacle") for geom in root.worldbody.geom)
    root.worldbody.add("geom", name=f"hidden_obstacle_{number}", type="sphere", size=[values["size"]],
                       pos=values["position"], condim=6, rgba=[0.5, 0.5, 0.5, 0.3])  # fmt: skip


EFFECT = EffectKind(
    name="hidden_obstacle",
    formula="a fixed sphere",
    parameters=(
        Parameter("position", "m", length=3, scale=0.2),
        Parameter("size", "m", low=1e-4, high=10, scale=0.05, neutral=0.05),
    ),
    regimes=(Regime.IMPACT,),
    experiment="send more bodies past the place from other sides",
    edit=edit,
)
