"""Solids of uniform density: MuJoCo's geom sizes, bounding spheres, inertia and support functions."""

from __future__ import annotations

import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import SceneObject, half_extents


def geom_sizes(shape: str, half: np.ndarray) -> np.ndarray:
    """MuJoCo's geom sizes (B, 3) of one shape, from half extents (B, 3) m."""
    zero = np.zeros(len(half))
    if shape == "sphere":
        return np.stack([half[:, 0], zero, zero], 1)
    if shape == "cylinder":
        return np.stack([half[:, 0], half[:, 2], zero], 1)
    if shape == "capsule":
        return np.stack([half[:, 0], half[:, 2] - half[:, 0], zero], 1)
    return half


def bounding_radii(shape: str, half: np.ndarray) -> np.ndarray:
    """Radius (B,) m of the bounding sphere about the centre, from half extents (B, 3) m."""
    if shape in ("sphere", "capsule", "ellipsoid"):
        return half.max(1)
    if shape == "cylinder":
        return np.hypot(half[:, 0], half[:, 2])
    return np.linalg.norm(half, axis=1)


def unit_inertia(shape: str, half: np.ndarray) -> np.ndarray:
    """Principal moments of inertia per unit mass, (B, 3) m², from half extents (B, 3) m."""
    a, b, c = half[:, 0], half[:, 1], half[:, 2]
    if shape in ("sphere", "ellipsoid"):
        return np.stack([b * b + c * c, a * a + c * c, a * a + b * b], 1) / 5
    if shape == "box":
        return np.stack([b * b + c * c, a * a + c * c, a * a + b * b], 1) / 3
    if shape == "cylinder":
        across = a * a / 4 + c * c / 3
        return np.stack([across, across, a * a / 2], 1)
    assert shape == "capsule"
    h = c - a  # half length without the caps
    cylinder, caps = 2 * h, 4 * a / 3  # volumes divided by pi a²
    along = (cylinder * a * a / 2 + caps * 0.4 * a * a) / (cylinder + caps)
    across = (cylinder * (a * a / 4 + h * h / 3) + caps * (0.4 * a * a + h * h + 0.75 * h * a)) / (cylinder + caps)
    return np.stack([across, across, along], 1)


def reach_below(obj: SceneObject) -> float:
    """Distance from the centre of the body down to its lowest point, m."""
    return float(reaches_below(obj.shape, half_extents(obj)[None], np.array(obj.orientation)[None])[0])


def reaches_below(shape: str, half: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """`reach_below` (B,) of one shape, from half extents (B, 3) m and orientations (B, 4)."""
    return support(shape, half, matrix_from_quaternion(quaternion)[:, 2])


def support(shape: str, half: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Support function (B,) m: the extent of one shape from its centre in given directions.

    half: half extents (B, 3) m. direction: unit vectors (B, 3) in the body frame.
    """
    along = np.abs(direction)
    if shape == "sphere":
        return half[:, 0]
    if shape == "box":
        return np.sum(half * along, 1)
    if shape == "ellipsoid":
        return np.linalg.norm(half * along, axis=1)
    if shape == "cylinder":
        across = np.sqrt(np.maximum(0.0, 1 - along[:, 2] ** 2))
        return half[:, 0] * across + half[:, 2] * along[:, 2]
    return (half[:, 2] - half[:, 0]) * along[:, 2] + half[:, 0]  # capsule
