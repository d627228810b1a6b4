"""One unseen blow."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

WIDTH = 1 / 240  # s: one step of the simulation


def kick(values: Values) -> tuple[np.ndarray, np.ndarray]:
    return values["time"], values["momentum"]


def force(values: Values, body: Body) -> np.ndarray:
    """All of the momentum within the one step that begins nearest to the time."""
    since = body.time - values["time"]
    now = (since >= -WIDTH / 2) & (since < WIDTH / 2)
    return (now / WIDTH)[..., None] * values["momentum"] + 0 * body.velocity


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
)
