"""Something unseen and fixed attracts (or repels), as the inverse square of the distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Observed, Start
from pipeline.scene.effects.hiding import Hiding, Setting
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

LEAST_DISTANCE = 0.02  # m, below which the force no longer grows
GRID = 8  # places along each axis at which a fit may begin


def force(values: Values, body: Body) -> np.ndarray:
    away = values["position"] - body.position
    square = np.einsum("...i,...i->...", away, away) + LEAST_DISTANCE**2
    return (values["strength"] / (square * np.sqrt(square)))[..., None] * away


def starts(observed: Observed) -> list[Start]:
    """At a grid of places in and around the box of all positions."""
    low, high = observed.positions.min(0), observed.positions.max(0)
    pad = 0.2 * max(float((high - low).max()), 0.2)
    axes = [np.linspace(a - pad, b + pad, GRID if b - a > 0.05 else 2) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return [Start(np.array([*p, 0.0]), np.array([[0, 0, 0, 1e-3]])) for p in grid]


def hidden_values(s: float, at: Setting) -> dict[str, Any]:
    return {"position": tuple(at.place), "strength": at.sign * 0.3 * s * at.mass}


EFFECT = EffectKind(
    name="hidden_attractor",
    formula="F = k r / |r|^3 towards a fixed point",
    parameters=(Parameter("position", "m", length=3, scale=0.2), Parameter("strength", "N m^2", scale=0.1)),
    regimes=EVERYWHERE,
    experiment="hold a body at rest at several places and measure the force on it",
    force=force,
    discovery=DiscoveryRules(starts=starts, starts_apart=True),
    hiding=Hiding(hidden_values, largest=12.0, resembles=frozenset({"spring"})),
)
