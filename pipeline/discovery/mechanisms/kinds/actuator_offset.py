"""The control is off by a constant."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.scene.effects.kind import Parameter

FIXED, NONE, AFFINE = (
    int(mujoco.mjtGain.mjGAIN_FIXED),
    int(mujoco.mjtBias.mjBIAS_NONE),
    int(mujoco.mjtBias.mjBIAS_AFFINE),
)


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    """A constant force: of actuators with a constant gain it is the same."""
    actuator = spec.actuator(name)
    if int(actuator.biastype) == NONE:
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.biasprm[:3] = 0.0
    actuator.biasprm[0] += actuator.gainprm[0] * values["offset"][0]


def may_act(mechanism: Mechanism, log: Log, place: Place) -> bool:
    k = mechanism.actuators.index(place.name)
    gain, bias = int(mechanism.model.actuator_gaintype[k]), int(mechanism.model.actuator_biastype[k])
    return gain == FIXED and bias in (NONE, AFFINE)


EFFECT = MechanismEffect(
    name="actuator_offset",
    formula="u = stated u + offset",
    parameters=(Parameter("offset", "of the control"),),
    target=Target.ACTUATOR,
    experiment="command nothing, and see whether it pushes",
    sizes=lambda place: {"offset": place.spread},
    starts=lambda place: ({"offset": np.array([0.05 * place.spread])},),
    edit=edit,
    may_act=may_act,
    linear="offset",
)
