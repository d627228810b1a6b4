"""The control acts through a lag of first order, as of a motor's current."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.held_control import lagged
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.scene.effects.kind import Parameter

NONE = int(mujoco.mjtDyn.mjDYN_NONE)


def controls(values: Values, time: np.ndarray, control: np.ndarray, at: np.ndarray) -> np.ndarray:
    return lagged(time, control, at, float(values["time_constant"][0]))


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    actuator = spec.actuator(name)
    actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    actuator.dynprm[0] = values["time_constant"][0]


def may_act(mechanism: Mechanism, log: Log, place: Place) -> bool:
    """An actuator that has a state in the model has its own lag."""
    return int(mechanism.model.actuator_dyntype[mechanism.actuators.index(place.name)]) == NONE


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    return tuple({"time_constant": np.array([n * place.interval])} for n in (1.0, 5.0))


EFFECT = MechanismEffect(
    name="actuator_lag",
    formula="du/dt = (stated u - u) / time constant",
    parameters=(Parameter("time_constant", "s", low=1e-5, high=2),),
    target=Target.ACTUATOR,
    experiment="a step of the control: after a delay nothing moves at first; with a lag it begins at once",
    sizes=lambda place: {"time_constant": 5 * place.interval},
    starts=starts,
    edit=edit,
    controls=controls,
    linear="time_constant",
    may_act=may_act,
)
