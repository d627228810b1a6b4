"""A pinhole camera and the projection of points into its image.

The centre of pixel (col, row) is at (col + 0.5, row + 0.5) px; x points right and y down. Pixels are square and the
principal point is the centre of the image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Camera

REFERENCE_SIZE = 480, 320  # px, width and height of the pictures to which lengths in px refer


@dataclass(frozen=True)
class Pinhole:
    """The pose and field of view of a camera.

    Attributes:
        position_world: (3,) m.
        rotation_world: (3, 3), columns right, up, back; the camera looks along -back.
        fov_y_deg: Vertical field of view.
    """

    position_world: np.ndarray
    rotation_world: np.ndarray
    fov_y_deg: float


def pinhole(camera: Camera) -> Pinhole:
    """The pinhole of a scene's camera, from its pitch (it looks along +y, right is +x) or its orientation."""
    if camera.orientation is not None:
        rotation = matrix_from_quaternion(np.array(camera.orientation))
    else:
        assert camera.pitch is not None
        pitch = math.radians(camera.pitch)
        c, s = math.cos(pitch), math.sin(pitch)
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, -s, -c], [0.0, c, -s]])
    return Pinhole(np.array(camera.position, dtype=np.float64), rotation, float(camera.fov))


def focal_px(fov_y_deg: float, height: int) -> float:
    """Focal length, px, of an image that is `height` px high and has the vertical field of view `fov_y_deg`."""
    return height / (2.0 * math.tan(math.radians(fov_y_deg) / 2.0))


def fov_deg(focal: float, height: int) -> float:
    """Vertical field of view, degrees, of an image that is `height` px high, with a focal length in px."""
    return math.degrees(2.0 * math.atan(height / (2.0 * focal)))


def project(points_world: np.ndarray, camera: Pinhole, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Project points of the world into the image.

    Args:
        points_world: (..., 3) m.
        camera: The camera.
        width: Width of the image, px.
        height: Height of the image, px.

    Returns:
        Image points (..., 2) px and planar depths (...) m. A point with a depth of zero or less is not in front of
        the camera; its image point is meaningless.
    """
    local = (np.asarray(points_world, dtype=np.float64) - camera.position_world) @ camera.rotation_world
    depth = -local[..., 2]
    scale = focal_px(camera.fov_y_deg, height) / np.where(depth == 0, np.nan, depth)
    uv = np.stack([width / 2 + scale * local[..., 0], height / 2 - scale * local[..., 1]], axis=-1)
    return uv, depth
