"""Drag of the air at everyday speeds: quadratic in the speed."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body, length
from pipeline.scene.effects.discovery_rules import DiscoveryRules
from pipeline.scene.effects.fluid import Fluid
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def force(values: Values, body: Body) -> np.ndarray:
    return -values["coefficient"][..., None] * length(body.airspeed) * body.airspeed


EFFECT = EffectKind(
    name="air_drag",
    formula="F = -k |u| u",
    parameters=(Parameter("coefficient", "kg/m", low=0, scale=0.01),),
    regimes=EVERYWHERE,
    experiment="throw at half and at twice the speed: quadratic drag grows fourfold, linear drag twofold",
    force=force,
    fluid=lambda values: Fluid(quadratic=values["coefficient"]),
    discovery=DiscoveryRules(of_a_body=True, equals=lambda effect, experiment: frozenset({"wind"})),  # wind of no speed
    hiding=Hiding(
        lambda s, at: {"coefficient": 0.02 * s * at.mass}, wrong_law="drag_slope", resembles=frozenset({"cubic_drag"})
    ),
)
