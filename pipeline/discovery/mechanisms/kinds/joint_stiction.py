"""More dry friction of a joint near rest (Stribeck)."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter

FASTEST = 0.5  # of the root mean square speed: friction that is there at all speeds is no stiction


def friction(values: Values, velocity: float, force: float) -> float:
    return float(values["f"][0] * np.exp(-((velocity / values["speed"][0]) ** 2)))


def sizes(place: Place) -> dict[str, float]:
    return {"f": place.torque, "speed": place.speed}


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    f = np.array([0.1 * place.torque])
    return tuple({"f": f, "speed": np.array([share * place.speed])} for share in (0.1, 0.4))


EFFECT = MechanismEffect(
    name="joint_stiction",
    formula="tau = -f exp(-(v / s)^2) sign(v), holds at rest",
    parameters=(Parameter("f", "N m", low=0), Parameter("speed", "rad/s")),
    target=Target.JOINT,
    experiment="a slow ramp: it sticks and slips",
    sizes=sizes,
    starts=starts,
    bounds=lambda place: {"f": (0.0, np.inf), "speed": (0.01 * place.speed, FASTEST * place.speed)},
    friction=friction,
    linear="f",
)
