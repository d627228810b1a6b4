"""How a hidden law departs from the laws that discovery knows: a named law slightly wrong, or a law in no list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

UNLISTED = ("cubic_drag", "swirl", "pulsed", "spring")
"""Laws that are no effects."""
Acceleration = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""(time s, position (..., 3) m, velocity (..., 3) m/s) -> m/s²."""


@dataclass(frozen=True)
class LawPerturbation:
    """A departure from the named laws.

    Attributes:
        drag_slope: Relative change of the drag coefficient per m/s.
        spin_decay: 1/s, at which spins decay.
        extra: An acceleration that is in no list.
    """

    drag_slope: float = 0.0
    spin_decay: float = 0.0
    extra: Acceleration | None = None

    @property
    def is_none(self) -> bool:
        """Whether the laws are as they are named."""
        return self == NO_PERTURBATION


NO_PERTURBATION = LawPerturbation()
WRONG_LAWS = {"drag_slope": LawPerturbation(drag_slope=-0.03), "spin_decay": LawPerturbation(spin_decay=0.4)}
"""Perturbations of named laws."""


def draw_perturbation(
    wrong: str | None, unlisted: str | None, size: float, rng: np.random.Generator
) -> LawPerturbation:
    """One of `WRONG_LAWS`, or one of `UNLISTED` of a size and with a random direction; or none."""
    if wrong is not None:
        return WRONG_LAWS[wrong]
    if unlisted is None:
        return NO_PERTURBATION
    angle = rng.uniform(-np.pi, np.pi)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])

    def extra(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(v, axis=-1, keepdims=True)
        if unlisted == "cubic_drag":
            return -0.004 * size * speed**3 * v / np.maximum(speed, 1e-9)
        if unlisted == "swirl":
            return 0.6 * size * np.stack([np.sin(3 * x[..., 1]), np.sin(3 * x[..., 2]), np.sin(3 * x[..., 0])], -1)
        if unlisted == "pulsed":
            return 1.2 * size * np.sin(2 * np.pi * 2.5 * t) * axis + 0 * x
        return -2.0 * size * (x - np.array([0, 0, 5.0]))

    return LawPerturbation(extra=extra)
