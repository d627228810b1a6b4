"""A mass on a body that the model does not know, such as a tool or a load."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.inertia import add_point_mass
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    add_point_mass(spec, name, float(values["mass"][0]), np.array(values["position"]))


def sizes(place: Place) -> dict[str, float]:
    return {"mass": place.mass, "position": place.length}


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    """At the body's origin, and to all sides of it."""
    mass = np.array([0.1 * place.mass])
    sides = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * place.length
    return tuple({"mass": mass, "position": side} for side in sides)


EFFECT = MechanismEffect(
    name="payload",
    formula="a point of mass m, fixed to the body",
    parameters=(Parameter("mass", "kg", low=0), Parameter("position", "m", length=3)),
    target=Target.BODY,
    experiment="weigh the body, or drive it fast and slowly: its weight acts always, its inertia only fast",
    sizes=sizes,
    starts=starts,
    bounds=lambda place: {"mass": (0.0, 20 * place.mass), "position": (-4 * place.length, 4 * place.length)},
    edit=edit,
    linear="mass",
)
