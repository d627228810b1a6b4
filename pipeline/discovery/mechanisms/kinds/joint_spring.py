"""A spring at a joint."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.angles import angle_unit
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    """Two springs at one joint are one, with the sum of the stiffnesses and a rest between."""
    joint, k, rest = spec.joint(name), float(values["stiffness"][0]), float(values["rest"][0])
    unit, known = angle_unit(spec, joint), float(joint.stiffness[0])
    if known + k > 0:
        joint.springref = (known * joint.springref + k * rest * unit) / (known + k)
        joint.stiffness[0] = known + k


def sizes(place: Place) -> dict[str, float]:
    return {"stiffness": place.torque / place.spread, "rest": place.spread}


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    stiffness = np.array([0.1 * sizes(place)["stiffness"]])
    return tuple({"stiffness": stiffness, "rest": np.array([r])} for r in (place.middle, place.low, place.high))


EFFECT = MechanismEffect(
    name="joint_spring",
    formula="tau = -k (q - r)",
    parameters=(Parameter("stiffness", "N m/rad", low=0), Parameter("rest", "rad")),
    target=Target.JOINT,
    experiment="hold it at several positions and measure the force, slowly",
    sizes=sizes,
    starts=starts,
    edit=edit,
    linear="stiffness",
)
