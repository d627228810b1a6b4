"""Gravity is not along -z of the recording's frame: a sloped table or a camera that is not level."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Experiment
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values
from pipeline.scene.scene import Scene


def tilted(gravity: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """gravity (..., 3) turned about x, then about y, by tilt (..., 2 or more), rad."""
    a, b = tilt[..., 0], tilt[..., 1]
    x, y, z = gravity[..., 0], gravity[..., 1], gravity[..., 2]
    y, z = np.cos(a) * y - np.sin(a) * z, np.sin(a) * y + np.cos(a) * z
    return np.stack([np.cos(b) * x + np.sin(b) * z, y + 0 * b, np.cos(b) * z - np.sin(b) * x], -1)


def force(values: Values, body: Body) -> np.ndarray:
    return body.mass[..., None] * (tilted(body.gravity, values["tilt"]) - body.gravity)


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    root.option.gravity = tilted(np.array(root.option.gravity), np.array(values["tilt"]))


def equals(effect: Mapping[str, Any], experiment: Experiment) -> frozenset[str]:
    """A far attractor pulls evenly, but with a force that is the same for all masses."""
    return frozenset({"hidden_attractor"}) if experiment.one_body else frozenset()


EFFECT = EffectKind(
    name="tilted_gravity",
    formula="g is turned by the tilt about x, then about y",
    parameters=(Parameter("tilt", "rad", length=2, low=-1.5, high=1.5, scale=0.05),),
    regimes=EVERYWHERE,
    experiment="hang a plumb line in the picture",
    force=force,
    edit=edit,
    discovery=DiscoveryRules(equals=equals),
    hiding=Hiding(
        lambda s, at: {"tilt": tuple(0.03 * s * at.across)},
        largest=10.0,
        scenarios=("throw", "throw", "cube", "pair", "puck", "roll", "carom"),
    ),
)
