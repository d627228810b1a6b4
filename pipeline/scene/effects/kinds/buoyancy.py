"""The surrounding air or water carries a share of the weight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, GravityScale
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values
from pipeline.scene.scene import Scene


def force(values: Values, body: Body) -> np.ndarray:
    return -(values["fraction"] * body.mass)[..., None] * body.gravity


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    for name in objects:
        root.find("body", name).gravcomp = values["fraction"]


#: A fluid that carries more than half of the weight has an added mass of more than a quarter of the body's (Lamb,
#: Hydrodynamics, art. 92: half of the displaced mass, of a sphere) and its drag: this law alone is then not what acts.
MOST = 0.5


EFFECT = EffectKind(
    name="buoyancy",
    formula="F = -b m g",
    parameters=(Parameter("fraction", "-", low=0, high=2, scale=0.1, physical=(0.0, MOST)),),
    regimes=EVERYWHERE,
    experiment="repeat with a heavier body of the same size: buoyancy takes a smaller share of its weight",
    force=force,
    edit=edit,
    discovery=DiscoveryRules(gravity_scale=GravityScale(lambda effect: True, only_weakens=True)),
    hiding=Hiding(lambda s, at: {"fraction": 0.05 * s}, largest=10.0),
)
