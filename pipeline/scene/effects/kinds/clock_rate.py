"""Not physics: the recording's clock runs fast (above 1) or slow.

Cameras run at standard frame rates. A recording at a standard rate speaks against a wrong clock that would make its
true rate a non-standard one, and the other way round.
"""

from __future__ import annotations

import numpy as np

from pipeline.scene.effects.discovery_rules import DiscoveryRules, GravityScale, Numbers
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.kind import EVERYWHERE, EffectKind, Parameter, Values

#: Frames per second of common cameras and trackers; also those of NTSC, slower by 1000/1001.
STANDARD = np.array([24.0, 25, 30, 48, 50, 60, 90, 100, 120, 150, 180, 200, 240, 250, 300, 360, 480, 500, 960, 1000])
EXACT = 2e-4  # relative: a smaller difference of rates is none


def recording(values: Values, times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return times * values["ratio"], positions


def is_standard(rate: float, tolerance: float) -> bool:
    """Whether a rate is within a relative tolerance of a standard one."""
    every = np.concatenate([STANDARD, STANDARD * 1000 / 1001])
    return bool((np.abs(rate / every - 1) < tolerance).any())


def frame_rate_evidence(values: Numbers, errors: Numbers, frame_rate: float) -> int:
    """1 where only the true frame rate would be standard, -1 where only the recorded one is, else 0."""
    ratio, error = values["ratio"], errors["ratio"]
    assert isinstance(ratio, float) and isinstance(error, float)
    recorded = is_standard(frame_rate, EXACT)
    true = is_standard(frame_rate * ratio, 2 * max(error, EXACT))
    return int(true) - int(recorded)


EFFECT = EffectKind(
    name="clock_rate",
    formula="recorded time = ratio x true time",
    parameters=(Parameter("ratio", "-", low=0.2, high=5, scale=0.05, neutral=1.0),),
    regimes=EVERYWHERE,
    experiment="film a second clock",
    recording=recording,
    discovery=DiscoveryRules(
        other_evidence=frame_rate_evidence,
        gravity_scale=GravityScale(lambda effect: bool(effect["ratio"] > 1)),
    ),
    hiding=Hiding(lambda s, at: {"ratio": 1 + at.sign * 0.02 * s}, largest=8.0),
)
