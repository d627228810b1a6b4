"""The control saturates."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter

SHARES = (0.85, 0.6, 0.35)  # of the largest control, at which fits begin


def largest(place: Place) -> float:
    return max(abs(place.low), abs(place.high), 1e-9)


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    actuator, limit = spec.actuator(name), float(values["limit"][0])
    low, high = actuator.ctrlrange if actuator.ctrlrange[0] < actuator.ctrlrange[1] else (-np.inf, np.inf)
    actuator.ctrlrange = (max(low, -limit), min(high, limit))
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE


EFFECT = MechanismEffect(
    name="actuator_limit",
    formula="u within +-limit",
    parameters=(Parameter("limit", "of the control", low=0),),
    target=Target.ACTUATOR,
    experiment="command a slow ramp up to the largest control",
    sizes=lambda place: {"limit": 0.2 * largest(place)},
    starts=lambda place: tuple({"limit": np.array([share * largest(place)])} for share in SHARES),
    bounds=lambda place: {"limit": (1e-3 * largest(place), largest(place))},
    edit=edit,
)
