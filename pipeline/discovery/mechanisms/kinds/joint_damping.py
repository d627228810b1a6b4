"""Friction of a joint that grows with its speed."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.joint(name).damping[0] += values["coefficient"][0]


EFFECT = MechanismEffect(
    name="joint_damping",
    formula="tau = -c v",
    parameters=(Parameter("coefficient", "N m s/rad", low=0),),
    target=Target.JOINT,
    experiment="swing at half and at twice the amplitude: viscous damping takes the same share of each swing",
    sizes=lambda place: {"coefficient": place.torque / place.speed},
    starts=lambda place: ({"coefficient": np.array([0.1 * (place.torque / place.speed)])},),
    edit=edit,
    linear="coefficient",
)
