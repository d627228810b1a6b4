"""Numbers of the user's model that are not known (`--fit`), and how they are read from MJCF and written to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.inertia import scale_mass
from pipeline.discovery.mechanisms.kind import SLIDE_UNITS, Place, Target
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.errors import ParamsError, did_you_mean

LARGEST = 1e9


@dataclass(frozen=True)
class Attribute:
    """A number of a joint, a body or an actuator.

    Attributes:
        unit: At a hinge.
        read: (document, name) -> the number that the user's document states.
        write: (document, name, value) writes it.
        size: (place, stated) -> a size that matters; fits take their steps from it.
        low: Lower bound.
    """

    unit: str
    read: Callable[[mujoco.MjSpec, str], float]
    write: Callable[[mujoco.MjSpec, str, float], None]
    size: Callable[[Place, float], float]
    low: float = 0.0


def _set_element(key: str) -> Callable[[mujoco.MjSpec, str, float], None]:
    def write(spec: mujoco.MjSpec, name: str, value: float) -> None:
        getattr(spec.joint(name), key)[0] = value

    return write


def _set_number(key: str) -> Callable[[mujoco.MjSpec, str, float], None]:
    def write(spec: mujoco.MjSpec, name: str, value: float) -> None:
        setattr(spec.joint(name), key, value)

    return write


def _mass(spec: mujoco.MjSpec, name: str) -> float:
    return float(spec.compile().body(name).mass[0])


def _set_gear(spec: mujoco.MjSpec, name: str, value: float) -> None:
    spec.actuator(name).gear[0] = value


def _set_gain(spec: mujoco.MjSpec, name: str, value: float) -> None:
    spec.actuator(name).gainprm[0] = value


ATTRIBUTES: dict[Target, dict[str, Attribute]] = {
    Target.JOINT: {
        "damping": Attribute(
            "N m s/rad",
            lambda s, n: float(s.joint(n).damping[0]),
            _set_element("damping"),
            lambda p, v: max(abs(v), p.torque / p.speed),
        ),
        "frictionloss": Attribute(
            "N m",
            lambda s, n: float(s.joint(n).frictionloss),
            _set_number("frictionloss"),
            lambda p, v: max(abs(v), p.torque),
        ),
        "armature": Attribute(
            "kg m^2",
            lambda s, n: float(s.joint(n).armature),
            _set_number("armature"),
            lambda p, v: max(abs(v), p.inertia),
        ),
        "stiffness": Attribute(
            "N m/rad",
            lambda s, n: float(s.joint(n).stiffness[0]),
            _set_element("stiffness"),
            lambda p, v: max(abs(v), p.torque / p.spread),
        ),
    },
    Target.BODY: {"mass": Attribute("kg", _mass, scale_mass, lambda p, v: v, low=1e-6)},
    Target.ACTUATOR: {
        "gear": Attribute(
            "-", lambda s, n: float(s.actuator(n).gear[0]), _set_gear, lambda p, v: max(abs(v), 1e-3), low=-LARGEST
        ),
        "gain": Attribute(
            "-", lambda s, n: float(s.actuator(n).gainprm[0]), _set_gain, lambda p, v: max(abs(v), 1e-3), low=-LARGEST
        ),
    },
}


@dataclass(frozen=True)
class FreeNumber:
    """A number that is fitted: of what, which one, and what the model states."""

    place: Place
    key: str
    stated: float

    @property
    def name(self) -> str:
        """As the user wrote it, with the name of the joint, body or actuator."""
        return f"{self.place.name}.{self.key}"

    @property
    def attribute(self) -> Attribute:
        """How it is read and written."""
        return ATTRIBUTES[self.place.target][self.key]

    @property
    def unit(self) -> str:
        """At this joint."""
        unit = self.attribute.unit
        return SLIDE_UNITS.get(unit, unit) if self.place.slide else unit


def free_numbers(
    names: Sequence[str], mechanism: Mechanism, places: dict[Target, tuple[Place, ...]]
) -> tuple[FreeNumber, ...]:
    """The numbers that `--fit` names: `elbow.damping` of one, `joint.damping` of all joints.

    Raises ParamsError for a name that is none of the model's.
    """
    out: dict[str, FreeNumber] = {}
    for name in names:
        owner, _, key = name.rpartition(".")
        found = [
            FreeNumber(place, key, attributes[key].read(mechanism.physics.copy(), place.name))
            for target, attributes in ATTRIBUTES.items()
            for place in places[target]
            if key in attributes and owner in (place.name, str(target))
        ]
        if not found:
            owners = [str(t) for t in ATTRIBUTES] + [p.name for t in ATTRIBUTES for p in places[t]]
            near = did_you_mean(owner, owners)
            keys = "; ".join(f"{t}: {', '.join(a)}" for t, a in ATTRIBUTES.items())
            raise ParamsError(
                f"fit: {name!r}{near} is no number of the model; valid: NAME.KEY with the name of a joint, a body or "
                f"an actuator, or joint, body, actuator for all of them, and as KEY {keys}"
            )
        out |= {f.name: f for f in found}
    return tuple(out.values())


def written(spec: mujoco.MjSpec, numbers: Sequence[FreeNumber], theta: np.ndarray) -> None:
    """Write fitted numbers (G,) into a document."""
    for number, value in zip(numbers, theta, strict=True):
        number.attribute.write(spec, number.place.name, float(value))
