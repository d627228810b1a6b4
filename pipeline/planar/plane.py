"""The plane in which the bodies of a clip move, parallel to the picture: from px to metres and back, and its camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.scene.scene import Camera
from pipeline.vision.rendering.camera import focal_px

FOV_DEG = 65.0  # of the longer side of the picture: a phone's main camera


@dataclass(frozen=True)
class Plane:
    """A plane parallel to the picture.

    Attributes:
        width: px, of the picture.
        height: px, of the picture.
        px_per_m: Scale of the plane in the picture.
        roll: rad, by which the world's vertical is turned from the picture's: gravity is along (sin, cos) of it, x
            right and y down. 0 where the plane is level.
        level: The plane is the ground, seen from above; else it is vertical.
    """

    width: int
    height: int
    px_per_m: float
    roll: float = 0.0
    level: bool = False

    @property
    def axes(self) -> np.ndarray:
        """(2, 2): the world's horizontal (of a level plane: x) and its vertical (y) in the picture, as rows."""
        c, s = np.cos(self.roll), np.sin(self.roll)
        return np.array([[c, -s], [-s, -c]])

    def to_world(self, px: np.ndarray) -> np.ndarray:
        """(..., 2) m, along the axes, of points (..., 2) px; the picture's centre is at (0, 0)."""
        return self.directions(np.asarray(px, float) - [self.width / 2, self.height / 2])

    def directions(self, px: np.ndarray) -> np.ndarray:
        """(..., 2) m, or m/s or m/s², of differences (..., 2) of points of the picture."""
        return np.asarray(px, float) @ self.axes.T / self.px_per_m

    def to_picture(self, world: np.ndarray) -> np.ndarray:
        """(..., 2) px of points (..., 2) m: the inverse of `to_world`."""
        return np.asarray(world, float) @ self.axes * self.px_per_m + [self.width / 2, self.height / 2]

    def in_space(self, plane: np.ndarray, off: float = 0.0) -> np.ndarray:
        """(..., 3) of vectors (..., 2) along the axes, `off` along the plane's normal."""
        plane = np.asarray(plane, float)
        normal = np.full(plane.shape[:-1], off)
        order = [plane[..., 0], plane[..., 1], normal] if self.level else [plane[..., 0], normal, plane[..., 1]]
        return np.stack(order, -1)

    def in_plane(self, space: np.ndarray) -> np.ndarray:
        """(..., 2) along the axes of vectors (..., 3): the inverse of `in_space`."""
        return np.asarray(space)[..., [0, 1]] if self.level else np.asarray(space)[..., [0, 2]]

    def height_of(self, space: np.ndarray) -> np.ndarray:
        """(...) m along the plane's normal of vectors (..., 3)."""
        return np.asarray(space)[..., 2 if self.level else 1]

    @property
    def fov_y_deg(self) -> float:
        """Vertical field of view of a camera whose longer side sees FOV_DEG."""
        return float(
            2 * np.degrees(np.arctan(np.tan(np.radians(FOV_DEG) / 2) * self.height / max(self.width, self.height)))
        )

    @property
    def distance(self) -> float:
        """m, of the camera from the plane."""
        return focal_px(self.fov_y_deg, self.height) / self.px_per_m

    def camera(self) -> Camera:
        """A camera that sees the plane so."""
        right, up = (
            self.in_space(np.array([np.cos(self.roll), -np.sin(self.roll)])),
            self.in_space(np.array([np.sin(self.roll), np.cos(self.roll)])),
        )
        back = np.cross(right, up)
        turn = Rotation.from_matrix(np.stack([right, up, back], 1)).as_quat(canonical=True, scalar_first=True)
        return Camera(tuple(self.distance * back), self.fov_y_deg, orientation=tuple(turn))
