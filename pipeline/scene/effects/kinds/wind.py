"""Air that moves as a whole. It acts through a drag of its own, and other drags depend on it too."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body, length
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Observed, Start
from pipeline.scene.effects.fluid import Fluid
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def air_velocity(values: Values, body: Body) -> np.ndarray:
    return values["velocity"]


def force(values: Values, body: Body) -> np.ndarray:
    return -values["coefficient"][..., None] * length(body.airspeed) * body.airspeed


def starts(observed: Observed) -> list[Start]:
    """At two speeds in eight directions: without drag the velocity has no effect."""
    out = []
    for speed in (1.5, 5.0):
        for angle in np.arange(8) * np.pi / 4:
            velocity = [speed * np.cos(angle), speed * np.sin(angle), 0.0]
            out.append(Start(np.array([*velocity, 0.0]), np.array([[0, 0, 0, 1e-4]])))
    return out


EFFECT = EffectKind(
    name="wind",
    formula="F = -k |v - w| (v - w)",
    parameters=(
        Parameter("velocity", "m/s", length=3, low=-30, high=30, scale=2.0),
        Parameter("coefficient", "kg/m", low=0, scale=0.01),
    ),
    regimes=EVERYWHERE,
    experiment="let a light body of the same shape go at rest: wind moves it",
    force=force,
    air_velocity=air_velocity,
    fluid=lambda values: Fluid(quadratic=values["coefficient"], velocity=values["velocity"]),
    discovery=DiscoveryRules(starts=starts, contains="air_drag"),
    hiding=Hiding(
        lambda s, at: {"velocity": at.wind, "coefficient": 0.02 * s * at.mass}, resembles=frozenset({"cubic_drag"})
    ),
)
