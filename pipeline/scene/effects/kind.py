"""What every effect's module declares."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.scene import Scene

Values = Mapping[str, np.ndarray]
"""Parameters by name: numbers (...), vectors (..., 3), which broadcast against the leading shape of a `Body`."""
Law = Callable[[Values, Body], np.ndarray]
Edit = Callable[[Any, Scene, Mapping[str, Any], tuple[str, ...]], None]


class Regime(StrEnum):
    """What a body is doing."""

    FLIGHT = "flight"
    IMPACT = "impact"
    SLIDING = "sliding"
    ROLLING = "rolling"
    SPINNING = "spinning"
    RESTING = "resting"


GROUNDED = (Regime.SLIDING, Regime.ROLLING, Regime.SPINNING, Regime.RESTING)
EVERYWHERE = (Regime.FLIGHT, *GROUNDED)


@dataclass(frozen=True)
class Parameter:
    """A number (length 1) or a vector of an effect. low, high: bounds of each component, open where infinite.

    scale: a size that matters in everyday motion, from which fits take their steps; neutral: the value without effect.
    """

    name: str
    unit: str
    length: int = 1
    low: float = -math.inf
    high: float = math.inf
    scale: float = 1.0
    neutral: float = 0.0
    required: bool = True


@dataclass(frozen=True)
class EffectKind:
    """A law with a name. What it does is said by those of its functions that are not None:

    force, torque: (values, body) -> (..., 3) N or N m, on the centre of mass; air_velocity, ground_velocity: the
    same, m/s; normal_force: (values, body) -> (...) N, pressing the body on what it touches;
    edit: writes the effect into an MJCF document where MuJoCo has it; `force` is then not applied by us;
    recording: (values, times, positions) -> those that a recording shows; such an effect is not physics;
    kick: (values) -> time (...) s and momentum (..., 3) N s of a blow.

    regimes: where it can be seen. needs: what measurements must have for it: "spin", "orientation", "others".
    formula: the law in words. experiment: what would tell it from effects that look the same.
    """

    name: str
    formula: str
    parameters: tuple[Parameter, ...]
    regimes: tuple[Regime, ...]
    experiment: str
    force: Law | None = None
    torque: Law | None = None
    air_velocity: Law | None = None
    ground_velocity: Law | None = None
    normal_force: Law | None = None
    edit: Edit | None = None
    recording: Callable[[Values, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    kick: Callable[[Values], tuple[np.ndarray, np.ndarray]] | None = None
    needs: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """How many numbers its parameters are."""
        return sum(p.length for p in self.parameters)

    @property
    def applied(self) -> bool:
        """Whether our program applies it as a force, plain MuJoCo having no such thing."""
        return self.edit is None and self.recording is None
