"""The objects attract each other (negative: repel), as the inverse square of their distance."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

LEAST_DISTANCE = 0.02  # m, below which the force no longer grows


def force(values: Values, body: Body) -> np.ndarray:
    away = body.others - body.position[..., None, :]
    square = np.einsum("...i,...i->...", away, away) + LEAST_DISTANCE**2
    return values["strength"][..., None] * (away / (square * np.sqrt(square))[..., None]).sum(-2)


EFFECT = EffectKind(
    name="pair_attraction",
    formula="F = k r / |r|^3 between objects",
    parameters=(Parameter("strength", "N m^2", scale=0.05),),
    regimes=EVERYWHERE,
    experiment="move one of the objects alone",
    force=force,
    discovery=DiscoveryRules(needs=(Need.OTHERS,)),
    hiding=Hiding(lambda s, at: {"strength": at.sign * 0.02 * s * at.mass}, largest=8.0, scenarios=("pair",)),
)
