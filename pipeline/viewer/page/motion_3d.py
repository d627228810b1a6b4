"""The motion of bodies as the 3D view of a page reads it (viewer.js): shapes, poses over time, ground, camera."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from pipeline.scene.mjcf import mesh_vertices
from pipeline.scene.scene import FixedBody, Scene, SceneObject, half_extents
from pipeline.vision.rendering.appearance import object_colour
from pipeline.vision.rendering.camera import pinhole

RATE = 60  # poses a second; the page interpolates between them


@dataclass(frozen=True)
class BodyPath:
    """A body over the frames of a page.

    Attributes:
        body: Its shape and sizes.
        colour: Index of its colour (`object_colour`).
        position: (F, 3) m; NaN where it is not there.
        quaternion: (F, 4), w x y z.
        ghost: Whether it is shown transparent, as what it is compared with.
    """

    body: SceneObject
    colour: int
    position: np.ndarray
    quaternion: np.ndarray
    ghost: bool = False


def sampled_steps(steps: int, rate: int) -> np.ndarray:
    """(F,) The steps, of `steps` + 1 at `rate` a second, that are RATE a second."""
    return np.arange(0, steps + 1, max(rate // RATE, 1))


def motion_record(scene: Scene, paths: Sequence[BodyPath], rate: float, aspect: float) -> dict[str, Any]:
    """The record, for JSON.

    Args:
        scene: Its ground, fixed bodies and camera are shown.
        paths: The moving bodies, all of F frames.
        rate: Frames a second.
        aspect: Width of the camera's picture over its height.
    """
    frames = len(paths[0].position) if paths else 1
    poses = np.zeros((frames, len(paths), 7), "<f4")
    for i, path in enumerate(paths):
        poses[:, i, :3], poses[:, i, 3:] = path.position, path.quaternion
    camera = None
    if scene.camera is not None:
        eye = pinhole(scene.camera)
        camera = {
            "position": eye.position_world.tolist(),
            "rotation": eye.rotation_world.ravel().tolist(),
            "fov": eye.fov_y_deg,
            "aspect": aspect,
        }
    return {
        "rate": rate,
        "frames": frames,
        "ground": scene.ground,
        "camera": camera,
        "bodies": [
            _shape(p.body) | {"colour": [c / 255 for c in object_colour(p.colour)], "ghost": p.ghost} for p in paths
        ],
        "fixed": [_shape(b) | {"position": list(b.position), "quaternion": list(b.orientation)} for b in scene.fixed],
        "poses": base64.b64encode(poses.tobytes()).decode(),
    }


def _shape(body: SceneObject | FixedBody) -> dict[str, Any]:
    """Name, shape and half extents; of a mesh its scale and the triangles of its convex hull, as MuJoCo has it."""
    if body.shape != "mesh":
        return {"name": body.name, "shape": body.shape, "half": half_extents(body).tolist()}
    assert body.file is not None
    vertices = mesh_vertices(body.file)
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]  # (K, 3, 3)
    inwards = (
        np.einsum(
            "ki,ki->k", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), hull.equations[:, :3]
        )
        < 0
    )
    corners[inwards] = corners[inwards][:, ::-1]
    return {
        "name": body.name,
        "shape": "mesh",
        "half": [body.size[0]] * 3,
        "triangles": base64.b64encode(corners.astype("<f4").tobytes()).decode(),
    }
