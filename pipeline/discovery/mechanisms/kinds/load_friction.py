"""Dry friction of a joint that grows with the load that its drive transmits."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Target, Values
from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.scene.effects.kind import Parameter


def friction(values: Values, velocity: float, force: float) -> float:
    return float(values["share"][0] * abs(force))


def may_act(mechanism: Mechanism, log: Log, place: Place) -> bool:
    """Only a driven joint transmits a load."""
    model, driven = mechanism.model, [mechanism.actuators.index(a) for a in log.driven]
    return any(model.actuator_trnid[k, 0] == place.joint and model.actuator_trntype[k] == 0 for k in driven)


EFFECT = MechanismEffect(
    name="load_friction",
    formula="tau = -share |force of the drive| sign(v), holds at rest",
    parameters=(Parameter("share", "-", low=0, high=1),),
    target=Target.JOINT,
    experiment="repeat with a payload: only this friction grows",
    sizes=lambda place: {"share": 0.3},
    starts=lambda place: ({"share": np.array([0.05])},),
    friction=friction,
    may_act=may_act,
    linear="share",
)
