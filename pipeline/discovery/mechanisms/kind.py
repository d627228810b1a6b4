"""What the module of an effect of mechanisms declares: its law, its parameters, and where fits begin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.scene.effects.kind import Parameter

Values = Mapping[str, np.ndarray]
"""Parameters by name, each an array of its length."""
#: Units of a hinge's parameter -> those of a slide's.
SLIDE_UNITS = {
    "rad": "m",
    "rad/s": "m/s",
    "N m": "N",
    "N m s/rad": "N s/m",
    "N m s^2/rad^2": "N s^2/m^2",
    "N m/rad": "N/m",
    "kg m^2": "kg",
}


class Target(StrEnum):
    """What an effect acts on; also the name of the parameter that says on which."""

    JOINT = "joint"
    ACTUATOR = "actuator"
    BODY = "body"
    WORLD = "world"


@dataclass(frozen=True)
class Place:
    """One thing on which an effect may act, and the sizes of its motion, from which fits take their steps.

    Attributes:
        target: What it is.
        name: Of the joint, actuator or body; empty: the world.
        joint: Index of the measured joint in the model; -1 of others.
        slide: Whether that joint slides.
        low, middle, high: Of the measured positions of the joint, or of the control.
        speed: Root mean square velocity of the joint, rad/s or m/s.
        torque: A size of the forces on the joint, N m or N; of the world, its gravity, m/s^2.
        inertia: Of the joint in the initial configuration, kg m^2 or kg.
        mass: Of what the body carries, kg.
        length: Of the body, m.
        interval: Between two samples, s.
    """

    target: Target
    name: str
    joint: int = -1
    slide: bool = False
    low: float = 0.0
    middle: float = 0.0
    high: float = 0.0
    speed: float = 1.0
    torque: float = 1.0
    inertia: float = 1.0
    mass: float = 1.0
    length: float = 1.0
    interval: float = 0.01

    @property
    def spread(self) -> float:
        """Of the measured positions or of the control."""
        return max(self.high - self.low, 1e-6)


@dataclass(frozen=True)
class MechanismEffect:
    """A law with a name. The functions that are not None say what it does.

    Attributes:
        name: As in report.json; the name of the module.
        formula: The law as text.
        parameters: Of the law, with the units of a hinge.
        target: What it acts on.
        experiment: What would tell it from effects that look the same.
        sizes: (place) -> a size of each parameter's components that matters there; fits take their steps from it.
        starts: (place) -> values at which fits begin. Each has a visible effect.
        bounds: (place) -> limits of each parameter's components, where they depend on the place.
        edit: (document, name of the place, values) writes the law into an MJCF document.
        friction: (values, velocity, force of the actuators) -> dry friction of the joint beside the model's, at each
            step of the simulation, where MJCF cannot say the law. Also the text of augmented_forces.py.
        controls: (values, times, control, at) -> mean control between the times `at`, from the one that was logged,
            held until the next row.
        measured: (values, position) -> what a sensor shows of it.
        sensor_lag: (values) -> s, by which a sensor shows the past.
        clock: (values) -> recorded time over true time.
        neutral: (place) -> values without effect, where they depend on the place.
        may_act: (mechanism, log, place) -> whether it could act there and be seen.
        linear: Name of the parameter in whose size the law is linear; None where there is none.
    """

    name: str
    formula: str
    parameters: tuple[Parameter, ...]
    target: Target
    experiment: str
    sizes: Callable[[Place], dict[str, float]]
    starts: Callable[[Place], Sequence[dict[str, np.ndarray]]]
    bounds: Callable[[Place], dict[str, tuple[float, float]]] | None = None
    edit: Callable[[mujoco.MjSpec, str, Values], None] | None = None
    friction: Callable[[Values, float, float], float] | None = None
    controls: Callable[[Values, np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None
    measured: Callable[[Values, np.ndarray], np.ndarray] | None = None
    sensor_lag: Callable[[Values], float] | None = None
    clock: Callable[[Values], float] | None = None
    may_act: Callable[[Mechanism, Log, Place], bool] | None = None
    linear: str | None = None
    neutral: Callable[[Place], dict[str, float]] | None = None

    @property
    def size(self) -> int:
        """Number of components of all parameters."""
        return sum(p.length for p in self.parameters)

    @property
    def of_measurement(self) -> bool:
        """Whether it is about the log, and not about the mechanism."""
        return any(law is not None for law in (self.measured, self.sensor_lag, self.clock))

    def unit(self, parameter: Parameter, slide: bool) -> str:
        """Of a parameter, at a hinge or at a slide."""
        return SLIDE_UNITS.get(parameter.unit, parameter.unit) if slide else parameter.unit
