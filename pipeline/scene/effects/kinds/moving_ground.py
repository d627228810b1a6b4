"""The ground's surface moves: a conveyor belt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.errors import SceneError
from pipeline.scene.effects.body import Body, direction
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import GROUNDED, EffectKind, Parameter, Values
from pipeline.scene.scene import Scene

LEAST_SLIP = 0.02  # m/s, below which friction fades


def ground_velocity(values: Values, body: Body) -> np.ndarray:
    v = values["velocity"]
    return np.concatenate([v, np.zeros_like(v[..., :1])], -1)


def patch_force(values: Values, body: Body) -> np.ndarray:
    """Friction against the slip on the moving ground, minus that on a ground at rest."""
    resting = body.slip + body.ground_velocity * np.array([1.0, 1.0, 0.0])
    limit = body.sliding_friction * body.normal_force
    return -limit[..., None] * (direction(body.slip, LEAST_SLIP) - direction(resting, LEAST_SLIP))


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    if scene.ground is None:
        raise SceneError("effects: moving_ground needs a ground; valid: ground: {height: 0.0}")
    root.find("geom", "ground").surfacevel = [*values["velocity"], 0.0]


EFFECT = EffectKind(
    name="moving_ground",
    formula="friction acts against the velocity relative to the moving ground",
    parameters=(Parameter("velocity", "m/s", length=2, low=-60, high=60, scale=0.2),),
    regimes=GROUNDED,
    experiment="put a body down at rest: a belt carries it along",
    ground_velocity=ground_velocity,
    edit=edit,
    patch_force=patch_force,
    hiding=Hiding(
        lambda s, at: {"velocity": tuple(0.05 * s * at.across)}, scenarios=("puck",), engines=("mujoco", "events")
    ),
)
