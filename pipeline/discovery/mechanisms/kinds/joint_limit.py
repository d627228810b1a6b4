"""A stop at which a joint ends."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.angles import angle_unit
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.scene.effects.kind import Parameter

FAR = 1e4  # rad or m: no stop
NEAR = (0.002, 0.02)  # of the spread of the motion: how far from its end the stop may be


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    joint = spec.joint(name)
    unit, upper = angle_unit(spec, joint), bool(values["side"][0] > 0)
    low, high = joint.range if joint.range[0] < joint.range[1] else (-FAR * unit, FAR * unit)
    stop = float(values["position"][0]) * unit
    joint.range = (low, max(min(stop, high), low + 1e-9)) if upper else (min(max(stop, low), high - 1e-9), high)
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE


def sizes(place: Place) -> dict[str, float]:
    return {"position": 0.05 * place.spread, "side": 0.0}


def starts(place: Place) -> tuple[dict[str, np.ndarray], ...]:
    """A little inside of both ends of the measured motion; side: 1 above, -1 below."""
    ends = ((place.high, 1.0), (place.low, -1.0))
    return tuple(
        {"position": np.array([end - side * near * place.spread]), "side": np.array([side])}
        for end, side in ends
        for near in NEAR
    )


EFFECT = MechanismEffect(
    name="joint_limit",
    formula="q stays on one side of a position",
    parameters=(Parameter("position", "rad"), Parameter("side", "1 above, -1 below")),
    target=Target.JOINT,
    experiment="move it slowly towards both ends",
    sizes=sizes,
    starts=starts,
    edit=edit,
)
