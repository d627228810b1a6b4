"""Lift of a spinning body, perpendicular to its spin and its velocity.

Without a measured spin only the product of coefficient and spin can be found. The coefficient is then that of a ball
in air whose lift coefficient is r w / u: F = 1/2 rho pi r^2 (r w / u) u^2, within a factor of two of measurements.
"""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Need
from pipeline.scene.effects.fluid import Fluid
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def force(values: Values, body: Body) -> np.ndarray:
    w, u = body.angular_velocity, body.airspeed
    cross = np.stack(
        [
            w[..., 1] * u[..., 2] - w[..., 2] * u[..., 1],
            w[..., 2] * u[..., 0] - w[..., 0] * u[..., 2],
            w[..., 0] * u[..., 1] - w[..., 1] * u[..., 0],
        ],
        axis=-1,
    )
    return values["coefficient"][..., None] * cross


AIR_DENSITY = 1.2  # kg/m³


def sphere_coefficient(radius: float) -> dict[str, float]:
    """The coefficient of a ball, by its radius, m, in air."""
    return {"coefficient": AIR_DENSITY / 2 * np.pi * radius**3}


EFFECT = EffectKind(
    name="magnus_lift",
    formula="F = s w x u",
    parameters=(Parameter("coefficient", "kg", scale=0.001),),
    regimes=EVERYWHERE,
    experiment="throw with the spin reversed: lift changes its side",
    force=force,
    fluid=lambda values: Fluid(lift=values["coefficient"]),
    discovery=DiscoveryRules(needs=(Need.SPIN,), must_beat_shuffled_spins=True, unmeasured_spin=sphere_coefficient),
    hiding=Hiding(lambda s, at: {"coefficient": 0.005 * s * at.mass * at.sign}, wrong_law="spin_decay"),
)
