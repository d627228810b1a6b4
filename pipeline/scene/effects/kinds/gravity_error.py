"""Gravity has another strength than stated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body, length
from pipeline.scene.effects.discovery_rules import DiscoveryRules, GravityScale
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values
from pipeline.scene.scene import Scene

DOWN = np.array([0.0, 0.0, -1.0])


def force(values: Values, body: Body) -> np.ndarray:
    size = length(body.gravity)
    down = np.where(size > 0, body.gravity / np.maximum(size, 1e-12), DOWN)
    return body.mass[..., None] * (values["gravity"][..., None] * down - body.gravity)


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    stated = np.array(root.option.gravity)
    size = np.linalg.norm(stated)
    root.option.gravity = values["gravity"] * (stated / size if size else DOWN)


def stated(scene: Scene) -> float:
    return float(np.linalg.norm(scene.gravity))


#: From the Moon's, 1.62 m/s², to Jupiter's, 24.8 m/s² (NASA, Planetary Fact Sheet).
ON_BODIES = (1.6, 25.0)


EFFECT = EffectKind(
    name="gravity_error",
    formula="g is not what was stated",
    parameters=(
        Parameter("gravity", "m/s^2", low=0, high=100, scale=1.0, neutral=9.81, stated=stated, physical=ON_BODIES),
    ),
    regimes=EVERYWHERE,
    experiment="time a pendulum of known length at the same place",
    force=force,
    edit=edit,
    discovery=DiscoveryRules(
        scene_parameter="gravity",
        gravity_scale=GravityScale(lambda effect: bool(effect["gravity"] < 9.81)),
    ),
    hiding=Hiding(lambda s, at: {"gravity": 9.81 + at.sign * 0.5 * s}, largest=8.0),
)
