"""How an effect is hidden in worlds: in which experiments and engines, and with which parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.scene.scene import SceneObject

FLYING = ("throw", "throw", "throw", "cube", "pair")
"""Experiments in the air, as often as they are drawn."""
DETECTION_ERRORS = 3.0
"""The detection limit of an effect, in standard errors."""
ENGINES = ("mujoco", "events", "bullet")
Launches = Sequence[tuple[SceneObject, ...]]
"""Of each clip the bodies with their initial states."""


@dataclass(frozen=True)
class Setting:
    """The first body of an experiment, and random numbers that an effect may use.

    Attributes:
        mass: kg.
        radius: m.
        sign: 1 or -1.
        across: (2,) unit vector along the ground.
        direction: (3,) unit vector, along the ground for bodies on it.
        place: (3,) m, a point near the paths.
        wind: (3,) m/s.
        time: s, during the clip.
    """

    mass: float
    radius: float
    sign: float
    across: np.ndarray
    direction: np.ndarray
    place: np.ndarray
    wind: tuple[float, ...]
    time: float


@dataclass(frozen=True)
class Hiding:
    """How an effect is hidden.

    Attributes:
        values: (size, setting) -> the parameters of the effect, proportional to `size` as far as they can be.
        largest: Largest size that is sane.
        scenarios: The experiments in which the effect shows, as often as they are drawn.
        engines: The engines that can simulate it, of `ENGINES`.
        wrong_law: How its law may be perturbed, of `pipeline.hidden.law_perturbation.WRONG_LAWS`.
        resembles: Laws in no list that it resembles, of `pipeline.hidden.law_perturbation.UNLISTED`. It may be named
            for one of them if a remainder is reported, too.
        shows_in_spin: Whether it changes spins and not positions.
        draw: (launches, strength, sign, rng) -> parameters, of an effect whose size has no detection limit.
    """

    values: Callable[[float, Setting], dict[str, Any]] | None = None
    largest: float = 15.0
    scenarios: tuple[str, ...] = FLYING
    engines: tuple[str, ...] = ENGINES
    wrong_law: str | None = None
    resembles: frozenset[str] = frozenset()
    shows_in_spin: bool = False
    draw: Callable[[Launches, float, float, np.random.Generator], dict[str, Any]] | None = None
