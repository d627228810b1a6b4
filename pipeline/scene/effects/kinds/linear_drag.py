"""Drag proportional to the speed, as in slow motion through a viscous fluid."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules
from pipeline.scene.effects.fluid import Fluid
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def force(values: Values, body: Body) -> np.ndarray:
    return -values["coefficient"][..., None] * body.airspeed


EFFECT = EffectKind(
    name="linear_drag",
    formula="F = -c u",
    parameters=(Parameter("coefficient", "kg/s", low=0, scale=0.05),),
    regimes=EVERYWHERE,
    experiment="throw at half and at twice the speed: quadratic drag grows fourfold, linear drag twofold",
    force=force,
    fluid=lambda values: Fluid(linear=values["coefficient"]),
    discovery=DiscoveryRules(of_a_body=True),
    hiding=Hiding(lambda s, at: {"coefficient": 0.1 * s * at.mass}, resembles=frozenset({"cubic_drag"})),
)
