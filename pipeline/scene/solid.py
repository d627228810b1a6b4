"""Bodies of uniform density: MuJoCo's geom sizes, bounding spheres, inertia and support functions."""

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
    if shape == "plane":
        return np.stack([zero, zero, zero + 1], 1)  # unbounded; the last is the spacing of the grid that MuJoCo draws
    return half


def bounding_radii(shape: str, half: np.ndarray) -> np.ndarray:
    """Radius (B,) m of the bounding sphere about the centre, from half extents (B, 3) m."""
    if shape in ("sphere", "capsule", "ellipsoid"):
        return half.max(1)
    if shape == "cylinder":
        return np.hypot(half[:, 0], half[:, 2])
    return np.linalg.norm(half, axis=1)


def unit_inertia(shape: str, half: np.ndarray, hollow: np.ndarray) -> np.ndarray:
    """Principal moments of inertia per unit mass, (B, 3) m², from half extents (B, 3) m.

    hollow (B,): inner over outer radius of spheres and cylinders; 0 for a solid, 1 for a thin shell. A hollow cylinder
    is a pipe with open ends.
    """
    a, b, c = half[:, 0], half[:, 1], half[:, 2]
    h = hollow
    if shape == "sphere":  # 2/5 (R⁵ - r⁵) / (R³ - r³), divided by R - r so that a thin shell has a value
        grown = (1 + h * (1 + h * (1 + h * (1 + h)))) / (1 + h * (1 + h))
        return np.stack([b * b + c * c, a * a + c * c, a * a + b * b], 1) / 5 * grown[:, None]
    if shape == "ellipsoid":
        return np.stack([b * b + c * c, a * a + c * c, a * a + b * b], 1) / 5
    if shape == "box":
        return np.stack([b * b + c * c, a * a + c * c, a * a + b * b], 1) / 3
    if shape == "cylinder":
        grown = 1 + h * h
        across = a * a / 4 * grown + c * c / 3
        return np.stack([across, across, a * a / 2 * grown], 1)
    assert shape == "capsule"
    s = c - a  # half length without the caps
    cylinder, caps = 2 * s, 4 * a / 3  # volumes divided by pi a²
    along = (cylinder * a * a / 2 + caps * 0.4 * a * a) / (cylinder + caps)
    across = (cylinder * (a * a / 4 + s * s / 3) + caps * (0.4 * a * a + s * s + 0.75 * s * a)) / (cylinder + caps)
    return np.stack([across, across, along], 1)


def principal_moments(obj: SceneObject) -> np.ndarray:
    """Principal moments of inertia of an object about its centre, (3,) kg m²."""
    return obj.mass * unit_inertia(obj.shape, half_extents(obj)[None], np.array([obj.hollow]))[0]


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
