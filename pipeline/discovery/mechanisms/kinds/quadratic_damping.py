"""Friction of a joint that grows with the square of its speed, as of a vane in air."""

from __future__ import annotations

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Target, Values
from pipeline.scene.effects.kind import Parameter


def edit(spec: mujoco.MjSpec, name: str, values: Values) -> None:
    spec.joint(name).damping[1] += values["coefficient"][0]


EFFECT = MechanismEffect(
    name="quadratic_damping",
    formula="tau = -k |v| v",
    parameters=(Parameter("coefficient", "N m s^2/rad^2", low=0),),
    target=Target.JOINT,
    experiment="swing at half and at twice the amplitude: it takes twice the share of a swing at twice the amplitude",
    sizes=lambda place: {"coefficient": place.torque / place.speed**2},
    starts=lambda place: ({"coefficient": np.array([0.1 * (place.torque / place.speed**2)])},),
    edit=edit,
    linear="coefficient",
)
