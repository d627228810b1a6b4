"""Sliding friction is not what it is elsewhere: a patch of felt, a spill of oil, a rougher side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene

LEAST_SLIP = 0.02  # m/s, below which friction fades


def of_first_body(scene: Scene) -> float:
    """Without effect: the friction that a scene states."""
    return scene.objects[0].sliding_friction


def force(values: Values, body: Body) -> np.ndarray:
    """The friction of this coefficient minus that of the body's own."""
    slip = body.slip
    speed = np.sqrt(slip[..., 0] ** 2 + slip[..., 1] ** 2 + LEAST_SLIP**2)
    more = (values["coefficient"] - body.sliding_friction) * body.normal_force
    return -(more / speed)[..., None] * slip


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    for name in objects:
        geom = root.find("geom", name)
        geom.friction = np.array([values["coefficient"], *geom.friction[1:]])


EFFECT = EffectKind(
    name="friction_error",
    formula="friction coefficient N in place of the body's own",
    parameters=(Parameter("coefficient", "-", low=0.0, high=10.0, scale=0.2, stated=of_first_body),),
    regimes=(Regime.SLIDING,),
    experiment="slide it through the place along other lines and at other speeds",
    force=force,
    edit=edit,
    discovery=DiscoveryRules(local=True),
)
