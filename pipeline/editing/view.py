"""The camera of a clip, what rests before it, and the tables of moving bodies that the ray casting takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.compiled import kernel
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Scene, SceneObject
from pipeline.scene.solid import bounding_radii
from pipeline.vision.rendering.camera import Pinhole, focal_px, pinhole, project
from pipeline.vision.rendering.rasteriser import background_depth, bounds, camera_frame
from pipeline.vision.rendering.shading_tables import AXES, CENTRE, HALF, KIND, RADIUS
from pipeline.vision.rendering.surface import shape_arrays


@dataclass(frozen=True)
class View:
    """A camera at rest and what does not move in front of it.

    Attributes:
        camera: The camera.
        inverse_depth: (H, W) 1/m, planar depth of ground and fixed bodies; 0 where there are none.
    """

    camera: Pinhole
    inverse_depth: np.ndarray

    @property
    def height(self) -> int:
        return int(self.inverse_depth.shape[0])

    @property
    def width(self) -> int:
        return int(self.inverse_depth.shape[1])

    @cached_property
    def ray_arguments(self) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
        """Eye, rotation, focal length (px) and inverse depth, as the kernels of `camera_rays` take them."""
        eye = np.ascontiguousarray(self.camera.position_world, dtype=np.float64)
        rotation = np.ascontiguousarray(self.camera.rotation_world, dtype=np.float64)
        return eye, rotation, focal_px(self.camera.fov_y_deg, self.height), self.inverse_depth


def view_of(scene: Scene, width: int, height: int) -> View:
    """The view of a scene's camera, in pictures of `width` by `height` px. Raises SceneError for a fixed mesh."""
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    with np.errstate(divide="ignore"):
        near = 1 / background_depth(camera, width, height, scene.ground, scene.fixed).astype(np.float64)
    return View(camera, near)


@dataclass(frozen=True)
class BodyMotion:
    """N bodies at T times.

    Attributes:
        objects: N objects.
        position: (T, N, 3) m.
        quaternion: (T, N, 4) wxyz.
        shown: (T, N) bool, which of them there are.
    """

    objects: tuple[SceneObject, ...]
    position: np.ndarray
    quaternion: np.ndarray
    shown: np.ndarray

    @cached_property
    def tables(self) -> np.ndarray:
        """(T, N, 17), as in `pipeline.vision.rendering.shading_tables`. Raises SceneError for a mesh."""
        kinds, halves = shape_arrays(self.objects)
        frames, count = self.shown.shape
        out = np.empty((frames, count, 17))
        out[..., KIND], out[..., HALF : HALF + 3] = kinds, halves
        for i, o in enumerate(self.objects):
            out[:, i, RADIUS] = bounding_radii(o.shape, halves[[i]])[0]
        out[..., CENTRE : CENTRE + 3] = self.position
        out[..., AXES : AXES + 9] = matrix_from_quaternion(self.quaternion).reshape(frames, count, 9)
        return out

    def only(self, bodies: Sequence[int]) -> BodyMotion:
        """The motion of some of the bodies, by their indices."""
        objects, which = tuple(self.objects[i] for i in bodies), list(bodies)
        return BodyMotion(objects, self.position[:, which], self.quaternion[:, which], self.shown[:, which])

    def rectangles(self, view: View) -> np.ndarray:
        """(T, N, 4) px: u0, u1, v0, v1 around each body; it may reach out of the picture."""
        eye, rotation, focal, _ = view.ray_arguments
        kinds, halves = shape_arrays(self.objects)
        out = np.empty((*self.shown.shape, 4))
        pose = np.ascontiguousarray(self.position, float), np.ascontiguousarray(self.quaternion, float)
        _rectangles(kinds, halves, *pose, eye, rotation, focal, float(view.width), float(view.height), out)
        return out

    def centres_px(self, view: View) -> np.ndarray:
        """(T, N, 2) px of the projected centres."""
        return project(self.position, view.camera, view.width, view.height)[0]


@kernel
def _rectangles(
    kinds: np.ndarray,
    halves: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    eye: np.ndarray,
    rotation: np.ndarray,
    focal: float,
    width: float,
    height: float,
    out: np.ndarray,
) -> None:
    frame = np.empty((4, 3))
    for t in range(out.shape[0]):
        for i in range(out.shape[1]):
            camera_frame(position[t, i], quaternion[t, i], eye, rotation, frame)
            covers, x0, x1, y0, y1 = bounds(kinds[i], halves[i], frame)
            out[t, i, :] = 0.0
            if covers == 2:  # the camera is inside or beside it
                out[t, i, 1], out[t, i, 3] = width, height
            elif covers == 1:
                out[t, i, 0], out[t, i, 1] = 0.5 * width + focal * x0, 0.5 * width + focal * x1
                out[t, i, 2], out[t, i, 3] = 0.5 * height - focal * y1, 0.5 * height - focal * y0


def within_px(one: BodyMotion, other: BodyMotion, view: View, tolerance: float) -> np.ndarray:
    """(T, N) bool: where bodies of two motions with the same objects are shown alike, to within `tolerance` px."""
    apart = np.linalg.norm(one.position - other.position, axis=-1)
    cosine = np.abs((one.quaternion * other.quaternion).sum(-1)).clip(0, 1)
    _, halves = shape_arrays(one.objects)
    apart += 2 * np.arccos(cosine) * np.linalg.norm(halves, axis=-1)
    depth = project(one.position, view.camera, view.width, view.height)[1]
    focal = focal_px(view.camera.fov_y_deg, view.height)
    near = apart * focal / np.maximum(depth, 1e-6) < tolerance
    return near & one.shown & other.shown
