"""A classical guess of the scene from instance masks, without learning.

Each instance is assumed to stand on the ground at the lowest pixel of its mask, to be as large as its outline, and to
have the velocity of its lowest point over the first frames. The camera is an average one. Shapes are given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.solid import reach_below
from pipeline.search.target import Target
from pipeline.vision.rendering.camera import REFERENCE_SIZE, Pinhole, focal_px, fov_deg, pinhole

USUAL_PITCH, PITCH_SPREAD = -22.4, 8.0  # deg, of cameras
CAMERA = Camera((0.0, -2.0, 0.95), fov=37.0, pitch=USUAL_PITCH)  # of pictures of REFERENCE_SIZE
GRAVITY = 7.0  # m/s²; unknown, as is the scale of a clip
NEAREST, FARTHEST = 0.6, 6.0  # m, range of the planar depth of the lowest point
LEAST_HALF, MOST_HALF = 0.03, 0.38  # m, range of half extents
FASTEST = 3.0  # m/s
TRACK_SECONDS = 0.35  # part of the track that gives the velocity


def usual_camera(width: int, height: int) -> Camera:
    """An average camera that makes pictures of width x height px: its field of view across the diagonal is usual."""
    focal = focal_px(CAMERA.fov, REFERENCE_SIZE[1]) * np.hypot(width, height) / np.hypot(*REFERENCE_SIZE)
    return replace(CAMERA, fov=fov_deg(float(focal), height))


@dataclass(frozen=True)
class MaskTrack:
    """The bounding boxes of an instance over time.

    Attributes:
        frames: (T,) indices of the target's frames that show it.
        feet_px: (T, 2) middle of the lower edge.
        size_px: (T, 2) width and height.
        whole: (T,) whether it is not cut off by the border of the picture.
    """

    frames: np.ndarray
    feet_px: np.ndarray
    size_px: np.ndarray
    whole: np.ndarray


def track_mask(masks: np.ndarray, instance: int) -> MaskTrack:
    """The track of an instance, counted from 0, in masks (F, H, W)."""
    height, width = masks.shape[1:]
    frames, feet, sizes, whole = [], [], [], []
    for k, mask in enumerate(masks):
        rows, columns = np.nonzero(mask == instance + 1)
        if len(rows) < 4:
            continue
        left, right, top, bottom = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
        frames.append(k)
        feet.append(((left + right) / 2, bottom))
        sizes.append((right - left, bottom - top))
        whole.append(left > 0 and top > 0 and right < width and bottom < height)
    return MaskTrack(
        np.array(frames, int),
        np.array(feet, float).reshape(-1, 2),
        np.array(sizes, float).reshape(-1, 2),
        np.array(whole, bool),
    )


def on_ground(points_px: np.ndarray, camera: Pinhole, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Intersections of rays with the ground z = 0.

    Args:
        points_px: (T, 2).
        camera: The camera.
        width: Width of the image, px.
        height: Height of the image, px.

    Returns:
        Points (T, 3) m, and their planar depths (T,) m, clipped to `NEAREST` and `FARTHEST`.
    """
    focal = focal_px(camera.fov_y_deg, height)
    local = np.stack(
        [(points_px[:, 0] - width / 2) / focal, (height / 2 - points_px[:, 1]) / focal, -np.ones(len(points_px))], 1
    )
    rays = local @ camera.rotation_world.T
    fall = np.minimum(rays[:, 2], -1e-6)
    depth = np.clip(-camera.position_world[2] / fall, NEAREST, FARTHEST)
    return camera.position_world + depth[:, None] * rays, depth


def guess_object(shape: str, seen: MaskTrack, target: Target, times: np.ndarray, camera: Pinhole) -> SceneObject:
    """An object of a given shape for one track.

    Args:
        shape: Its shape.
        seen: Its track.
        target: The target.
        times: (F,) of the target's frames, s.
        camera: The camera.
    """
    if not len(seen.frames):
        return SceneObject(shape, _size(shape, 0.15, 0.15), 1.0, position=(0.0, 1.0, 0.15))
    feet, depth = on_ground(seen.feet_px, camera, target.width, target.height)
    metres = seen.size_px * (depth / focal_px(camera.fov_y_deg, target.height))[:, None]
    use = seen.whole if seen.whole.any() else np.ones(len(depth), bool)
    half = np.clip(metres[use][:3].mean(0) / 2, LEAST_HALF, MOST_HALF)
    first = times[seen.frames[0]]
    early = np.flatnonzero(times[seen.frames] <= first + TRACK_SECONDS)
    velocity = np.zeros(3)
    if len(early) > 1:
        velocity[:2] = np.polyfit(times[seen.frames[early]], feet[early, :2], 1)[0]
        velocity *= min(1.0, FASTEST / max(float(np.linalg.norm(velocity)), 1e-9))
    sight = feet[0] - camera.position_world
    along = np.hypot(sight[0], sight[1])
    # The lowest visible point is on the near side of a body. For a ball it is where the tangent ray meets the ground.
    behind = half[0] * (np.tan(np.arctan2(-sight[2], along) / 2) if shape == "sphere" else 1.0)
    middle = feet[0] + behind * np.array([sight[0], sight[1], 0]) / along - velocity * first
    spin = np.cross([0.0, 0.0, 1.0], velocity) / half[0] if shape == "sphere" else np.zeros(3)
    obj = usual_object(shape, _size(shape, *half))
    obj = replace(obj, velocity=tuple(velocity), angular_velocity=tuple(spin))
    return replace(obj, position=(middle[0], middle[1], reach_below(obj)))


def usual_object(shape: str, size: tuple[float, ...]) -> SceneObject:
    """An object with the material that is assumed where nothing is known of it; at rest."""
    return SceneObject(shape, size, mass=1.0, sliding_friction=0.4, rolling_friction=0.002, damping=0.6)


def _size(shape: str, across: float, up: float) -> tuple[float, ...]:
    """Sizes, m, of a body whose outline has the given half width and half height, m."""
    if shape == "sphere":
        return (0.5 * (across + up),)
    if shape in ("cylinder", "capsule"):
        return (across, max(2 * up, 2.1 * across if shape == "capsule" else 0.0))
    return (1.6 * across, 1.6 * across, 1.8 * up)


def guess_scene(target: Target, shapes: Sequence[str], times: np.ndarray) -> Scene:
    """A scene in which object i has shape shapes[i] and represents instance i.

    Args:
        target: What is to be shown.
        shapes: Of the instances.
        times: (F,) of the frames, s.
    """
    assert len(shapes) == target.instances
    camera = usual_camera(target.width, target.height)
    view = pinhole(camera)
    objects = [guess_object(shape, track_mask(target.masks, i), target, times, view) for i, shape in enumerate(shapes)]
    return Scene(tuple(objects), camera, (0.0, 0.0, -GRAVITY))
