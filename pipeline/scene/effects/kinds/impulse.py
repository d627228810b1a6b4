"""One unseen blow, at the same time of every clip."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DiscoveryRules, Observed, Start
from pipeline.scene.effects.hiding import Hiding, Setting
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

WIDTH = 1 / 240  # s: one step of the simulation, in which the force rises and in which it falls


def kick(values: Values) -> tuple[np.ndarray, np.ndarray]:
    return values["time"], values["momentum"]


def force(values: Values, body: Body) -> np.ndarray:
    """A triangle in time, whose sum over steps is the momentum, and its centre the time, wherever they begin."""
    share = np.maximum(1 - np.abs(body.time - values["time"]) / WIDTH, 0.0)
    return (share / WIDTH)[..., None] * values["momentum"] + 0 * body.velocity


def starts(observed: Observed) -> list[Start]:
    """At 30 times of the recording."""
    times = np.linspace(observed.first, observed.last, 34)[2:-2]
    return [Start(np.array([t, 0, 0, 0]), np.hstack([np.zeros((3, 1)), 0.02 * np.eye(3)])) for t in times]


def hidden_values(s: float, at: Setting) -> dict[str, Any]:
    return {"time": at.time, "momentum": tuple(0.1 * s * at.mass * at.direction)}


EFFECT = EffectKind(
    name="impulse",
    formula="momentum p at the time",
    parameters=(
        Parameter("time", "s", low=0, scale=0.02, neutral=0.5),
        Parameter("momentum", "N s", length=3, scale=0.1),
    ),
    regimes=EVERYWHERE,
    experiment="repeat the recording: a blow does not come again at the same time",
    force=force,
    kick=kick,
    discovery=DiscoveryRules(starts=starts),
    hiding=Hiding(hidden_values, engines=("mujoco", "events")),
)
