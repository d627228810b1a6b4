"""The plane in which the bodies of a clip move: from px of a camera that looks straight at it to metres and back.

The clip's own camera may be turned from that one (`pipeline.worlds.tilt`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.scene.scene import Camera
from pipeline.vision.rendering.camera import focal_px
from pipeline.worlds.tilt import Tilt

FOV_DEG = 65.0  # of the longer side of the picture: a phone's main camera
FLIP = np.diag([1.0, -1.0, -1.0])  # between axes right, up, back and axes right, down, ahead


@dataclass(frozen=True)
class Plane:
    """A plane, in the picture of a camera that looks straight at it.

    Attributes:
        width: px, of the picture.
        height: px, of the picture.
        px_per_m: Scale of the plane in the picture.
        roll: rad, by which the world's vertical is turned from the picture's: gravity is along (sin, cos) of it, x
            right and y down. 0 where the plane is level.
        level: The plane is the ground, seen from above; else it is vertical.
        tilt: By which the clip's own camera is turned from that one; None: not at all.
    """

    width: int
    height: int
    px_per_m: float
    roll: float = 0.0
    level: bool = False
    tilt: Tilt | None = None

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

    def straight_track(self, track: ImageTrack) -> ImageTrack:
        """A track of the clip's own picture in that of the camera that looks straight at the plane."""
        return track if self.tilt is None else self.tilt.straight_track(track)

    @property
    def focal(self) -> float:
        """px."""
        return focal_px(self.fov_y_deg, self.height)

    @property
    def distance(self) -> float:
        """m, of the camera from the plane."""
        return self.focal / self.px_per_m

    def camera(self) -> Camera:
        """The clip's own camera."""
        right, up = (
            self.in_space(np.array([np.cos(self.roll), -np.sin(self.roll)])),
            self.in_space(np.array([np.sin(self.roll), np.cos(self.roll)])),
        )
        back = np.cross(right, up)
        rotation = np.stack([right, up, back], 1)
        if self.tilt is not None:
            rotation = rotation @ (FLIP @ self.tilt.rotation @ FLIP)
        turn = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
        return Camera(tuple(self.distance * back), self.fov_y_deg, orientation=tuple(turn))
