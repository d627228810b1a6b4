"""Not physics: the recording's lengths are off by a factor."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.discovery_rules import DiscoveryRules, GravityScale
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def recording(values: Values, times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return times, positions * values["ratio"]


EFFECT = EffectKind(
    name="length_scale",
    formula="recorded length = ratio x true length",
    parameters=(Parameter("ratio", "-", low=0.2, high=5, scale=0.05, neutral=1.0),),
    regimes=EVERYWHERE,
    experiment="film a ruler at the bodies' distance",
    recording=recording,
    discovery=DiscoveryRules(gravity_scale=GravityScale(lambda effect: bool(effect["ratio"] < 1))),
    hiding=Hiding(lambda s, at: {"ratio": 1 + at.sign * 0.02 * s}, largest=8.0),
)
