"""Friction that grows with the speed, while in contact: a wet or greasy table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Experiment
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import GROUNDED, EffectKind, Parameter, Values


def force(values: Values, body: Body) -> np.ndarray:
    touching = values["coefficient"] * (body.normal_force > 0)
    return -touching[..., None] * (body.velocity - body.ground_velocity) * np.array([1.0, 1.0, 0.0])


def equals(effect: Mapping[str, Any], experiment: Experiment) -> frozenset[str]:
    """A puck is never in the air, where only drag would act."""
    return frozenset({"linear_drag"}) if experiment.sliding else frozenset()


EFFECT = EffectKind(
    name="viscous_friction",
    formula="F = -c v_t while in contact",
    parameters=(Parameter("coefficient", "kg/s", low=0, scale=0.1),),
    regimes=GROUNDED,
    experiment="let it fly as well as slide: drag of the air acts in both, this only on the ground",
    force=force,
    discovery=DiscoveryRules(equals=equals),
    hiding=Hiding(
        lambda s, at: {"coefficient": 0.1 * s * at.mass},
        largest=20.0,
        scenarios=("puck",),
        engines=("mujoco", "events"),
    ),
)
