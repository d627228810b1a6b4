"""The control acts later than it was commanded."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.held_control import held
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter


def controls(values: Values, time: np.ndarray, control: np.ndarray, at: np.ndarray) -> np.ndarray:
    return held(time, control, at - values["delay"][0])


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    """MuJoCo's buffer of controls has to hold as many time steps as the delay has."""
    actuator, delay = spec.actuator(name), float(values["delay"][0])
    actuator.delay = delay
    actuator.nsample = int(np.ceil(delay / spec.option.timestep)) + 2


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    return tuple({"delay": np.array([n * place.interval])} for n in (1.0, 5.0))


EFFECT = MechanismEffect(
    name="actuator_delay",
    formula="u(t) = stated u(t - delay)",
    parameters=(Parameter("delay", "s", low=0, high=1),),
    target=Target.ACTUATOR,
    experiment="a step of the control: after a delay nothing moves at first; with a lag it begins at once",
    sizes=lambda place: {"delay": 5 * place.interval},
    starts=starts,
    edit=edit,
    controls=controls,
    linear="delay",
)
