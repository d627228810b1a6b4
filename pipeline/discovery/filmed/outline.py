"""The outline in the picture that a body of known shape has at a place."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import SceneObject, half_extents
from pipeline.vision.rendering.camera import Pinhole, project

POINTS = 64
_ANGLES = np.linspace(0, 2 * np.pi, POINTS, endpoint=False)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)


def outline(obj: SceneObject, place: np.ndarray, camera: Pinhole, width: int, height: int) -> np.ndarray:
    """(POINTS, 2) px, the outline less where the body's centre is seen.

    Args:
        obj: Its shape, size and orientation.
        place: (3,) m, of its centre.
        camera: That sees it.
        width: px.
        height: px.
    """
    centre = project(place[None], camera, width, height)[0][0]
    if obj.shape == "sphere":
        return np.asarray(project(_sphere_edge(obj.size[0], place, camera), camera, width, height)[0] - centre)
    half = half_extents(obj)
    if obj.shape == "cylinder":
        rim = half[0] * _CIRCLE
        corners = np.concatenate([np.column_stack([rim, np.full(POINTS, z)]) for z in (-half[2], half[2])])
    else:
        corners = half * (np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3))
    turned = corners @ matrix_from_quaternion(np.array(obj.orientation)).T
    seen = project(place + turned, camera, width, height)[0] - centre
    hull = cv2.convexHull(seen.astype(np.float32))[:, 0].astype(float)
    return _even(hull)


def _sphere_edge(radius: float, place: np.ndarray, camera: Pinhole) -> np.ndarray:
    """(POINTS, 3) m, where lines of sight touch a sphere."""
    away = place - camera.position_world
    far = float(np.linalg.norm(away))
    axis = away / far
    right = np.cross(axis, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0, 0])
    up = np.cross(right, axis)
    rim = radius * np.sqrt(max(1 - (radius / far) ** 2, 0.0))
    ring: np.ndarray = place - radius**2 / far * axis + rim * (_CIRCLE[:, :1] * right + _CIRCLE[:, 1:] * up)
    return ring


def _even(polygon: np.ndarray) -> np.ndarray:
    """POINTS points at equal distances along a closed polygon (N, 2)."""
    closed = np.vstack([polygon, polygon[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, length[-1], POINTS, endpoint=False)
    return np.stack([np.interp(at, length, c) for c in closed.T], 1)
