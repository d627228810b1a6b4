"""What a law is given of a body: arrays that broadcast, so that one law serves a scene, a batch and a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Body:
    """Bodies at one moment, in the world's frame; `...` is any leading shape.

    Attributes:
        time: (...) s.
        position: (..., 3) m, of the centre of mass.
        velocity: (..., 3) m/s, of the centre of mass.
        angular_velocity: (..., 3) rad/s.
        others: (..., M, 3) m, centres of the other objects.
        mass: (...) kg.
        radius: (...) m.
        gravity: (..., 3) m/s².
        normal_force: (...) N, of the ground on the body; 0 in the air.
        sliding_friction: (...).
        air_velocity: (..., 3) m/s.
        ground_velocity: (..., 3) m/s.
        step: (...) s, of which the laws give the mean; 0: at one moment.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    others: np.ndarray
    mass: np.ndarray
    radius: np.ndarray
    gravity: np.ndarray
    normal_force: np.ndarray
    sliding_friction: np.ndarray
    air_velocity: np.ndarray
    ground_velocity: np.ndarray
    step: np.ndarray | float = 0.0

    @property
    def airspeed(self) -> np.ndarray:
        """Velocity relative to the air, (..., 3) m/s."""
        return self.velocity - self.air_velocity

    @property
    def slip(self) -> np.ndarray:
        """Velocity of a ball's lowest point relative to the ground, (..., 3) m/s, with z = 0."""
        w = self.angular_velocity
        turning = self.radius[..., None] * np.stack([-w[..., 1], w[..., 0], 0 * w[..., 2]], -1)
        return (self.velocity - self.ground_velocity + turning) * np.array([1.0, 1.0, 0.0])


def length(vectors: np.ndarray) -> np.ndarray:
    """|v| (..., 1) of vectors (..., 3)."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]


def direction(vectors: np.ndarray, least: float) -> np.ndarray:
    """v / sqrt(|v|² + least²) (..., 3): nearly a unit vector, and smooth where v passes through zero."""
    return vectors / np.sqrt(np.einsum("...i,...i->...", vectors, vectors)[..., None] + least * least)
