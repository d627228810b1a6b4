"""Not physics: the recording's clock runs fast (above 1) or slow."""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values


def recording(values: Values, times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return times * values["ratio"], positions


EFFECT = EffectKind(
    name="clock_rate",
    formula="recorded time = ratio x true time",
    parameters=(Parameter("ratio", "-", low=0.2, high=5, scale=0.05, neutral=1.0),),
    regimes=EVERYWHERE,
    experiment="film a second clock",
    recording=recording,
)
