"""Exact optical flow of rigid bodies: each visible surface point is moved with its body and projected again.

flow[k] leads from frame k to frame k + 1, px, x right and y down, at the pixels where an object is seen in frame
k; it is zero elsewhere, since the camera stands still. A point that gets behind the camera has no image: its flow
is zero and it counts as hidden.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from pipeline.scene.scene import SceneObject
from pipeline.vision.camera import Pinhole
from pipeline.vision.rasteriser import Rendering, camera_frame, rasterise
from pipeline.vision.surface import intersect, shape_arrays

#: A moved point is hidden where something is nearer by this share of its depth.
_HIDDEN_SHARE = 1e-4


@dataclass(frozen=True)
class ExactFlow:
    """flow_px: float32 (F - 1, H, W, 2). hidden: bool (F - 1, H, W), where the moved point is not seen in the next
    frame: behind an object, itself or the ground, or out of the image."""

    flow_px: np.ndarray
    hidden: np.ndarray


@kernel
def exact_flow_frame(
    position_a: np.ndarray,
    quaternion_a: np.ndarray,
    position_b: np.ndarray,
    quaternion_b: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov_y_deg: float,
    mask: np.ndarray,
    depth: np.ndarray,
    within: tuple[int, int, int, int],
    flow: np.ndarray,
) -> None:
    """Fill flow float32 (H, W, 2), px, of one pair of poses (N, 3), (N, 4), at the pixels of objects.

    mask, depth: (H, W), the first frame's, and within: the rows and columns that it returned, from `rasterise_frame`.
    """
    height, width = mask.shape
    focal = height / (2.0 * math.tan(math.radians(fov_y_deg) * 0.5))
    count = position_a.shape[0]
    motion = np.empty((count, 3, 3))  # of points in the camera's frame, from one pose to the next
    shift = np.empty((count, 3))
    a, b = np.empty((4, 3)), np.empty((4, 3))
    for i in range(count):
        camera_frame(position_a[i], quaternion_a[i], camera_position, camera_rotation, a)
        camera_frame(position_b[i], quaternion_b[i], camera_position, camera_rotation, b)
        for r in range(3):
            for c in range(3):
                motion[i, r, c] = b[r, 0] * a[c, 0] + b[r, 1] * a[c, 1] + b[r, 2] * a[c, 2]
            shift[i, r] = b[r, 0] * (a[3, 0] - b[3, 0]) + b[r, 1] * (a[3, 1] - b[3, 1]) + b[r, 2] * (a[3, 2] - b[3, 2])
    inverse = 1.0 / focal
    row0, row1, col0, col1 = within
    for row in range(row0, row1):
        y = (0.5 * height - row - 0.5) * inverse
        for col in range(col0, col1):
            if mask[row, col] == 0:
                continue
            i = mask[row, col] - 1
            x = (col + 0.5 - 0.5 * width) * inverse
            t = np.float64(depth[row, col])
            right = t * (motion[i, 0, 0] * x + motion[i, 0, 1] * y - motion[i, 0, 2]) + shift[i, 0]
            up = t * (motion[i, 1, 0] * x + motion[i, 1, 1] * y - motion[i, 1, 2]) + shift[i, 1]
            ahead = -t * (motion[i, 2, 0] * x + motion[i, 2, 1] * y - motion[i, 2, 2]) - shift[i, 2]
            if ahead > 1e-9:
                scale = focal / ahead
                flow[row, col, 0] = right * scale - focal * x
                flow[row, col, 1] = focal * y - up * scale
            else:
                flow[row, col, 0] = flow[row, col, 1] = 0.0


@kernel
def hidden_frame(
    kinds: np.ndarray,
    half_sizes: np.ndarray,
    position_a: np.ndarray,
    quaternion_a: np.ndarray,
    position_b: np.ndarray,
    quaternion_b: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov_y_deg: float,
    ground: float,
    mask: np.ndarray,
    depth: np.ndarray,
    hidden: np.ndarray,
) -> None:
    """Fill hidden bool (H, W) of one pair of poses: whether a ray of the second frame meets something before the
    moved point. mask, depth: (H, W), the first frame's. ground: height, m, or nan."""
    height, width = mask.shape
    hidden[:] = False
    focal = height / (2.0 * math.tan(math.radians(fov_y_deg) * 0.5))
    count = kinds.shape[0]
    a, b = np.empty((count, 4, 3)), np.empty((count, 4, 3))
    for i in range(count):
        camera_frame(position_a[i], quaternion_a[i], camera_position, camera_rotation, a[i])
        camera_frame(position_b[i], quaternion_b[i], camera_position, camera_rotation, b[i])
    point = np.empty(3)
    for row in range(height):
        y = (0.5 * height - row - 0.5) / focal
        for col in range(width):
            if mask[row, col] == 0:
                continue
            i = mask[row, col] - 1
            x = (col + 0.5 - 0.5 * width) / focal
            for k in range(3):  # the point in its body's frame, from the second frame's camera
                ray = x * a[i, 0, k] + y * a[i, 1, k] - a[i, 2, k]
                point[k] = a[i, 3, k] + depth[row, col] * ray - b[i, 3, k]
            right = point[0] * b[i, 0, 0] + point[1] * b[i, 0, 1] + point[2] * b[i, 0, 2]
            up = point[0] * b[i, 1, 0] + point[1] * b[i, 1, 1] + point[2] * b[i, 1, 2]
            ahead = -(point[0] * b[i, 2, 0] + point[1] * b[i, 2, 1] + point[2] * b[i, 2, 2])
            if not ahead > 1e-9:
                hidden[row, col] = True
                continue
            u, v = right / ahead, up / ahead
            if abs(u) * focal > 0.5 * width or abs(v) * focal > 0.5 * height:
                hidden[row, col] = True
                continue
            limit = ahead * (1.0 - _HIDDEN_SHARE)
            fall = camera_rotation[2, 0] * u + camera_rotation[2, 1] * v - camera_rotation[2, 2]
            drop = ground - camera_position[2]
            if drop <= 0.0 and fall < 0.0 and drop / fall < limit:
                hidden[row, col] = True
                continue
            for j in range(count):
                view, half = b[j], half_sizes[j]
                t = intersect(
                    kinds[j],
                    half[0],
                    half[1],
                    half[2],
                    view[3, 0],
                    view[3, 1],
                    view[3, 2],
                    u * view[0, 0] + v * view[1, 0] - view[2, 0],
                    u * view[0, 1] + v * view[1, 1] - view[2, 1],
                    u * view[0, 2] + v * view[1, 2] - view[2, 2],
                )
                if t < limit:
                    hidden[row, col] = True
                    break


def exact_flow(
    objects: Sequence[SceneObject],
    positions: np.ndarray,
    quaternions: np.ndarray,
    camera: Pinhole,
    width: int,
    height: int,
    ground: float | None = 0.0,
    rendering: Rendering | None = None,
    with_hidden: bool = True,
) -> ExactFlow:
    """Flow and hidden points of F - 1 pairs of frames: positions (F, N, 3) m, quaternions (F, N, 4) wxyz.

    rendering: the same frames' from `rasterise`, where it is at hand. Without `with_hidden` nothing is hidden.
    """
    if rendering is None:
        rendering = rasterise(objects, positions, quaternions, camera, width, height, ground)
    kinds, half_sizes = shape_arrays(objects)
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    quaternions = np.ascontiguousarray(quaternions, dtype=np.float64)
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    plane = math.nan if ground is None else float(ground)
    pairs = max(len(positions) - 1, 0)
    flow = np.zeros((pairs, height, width, 2), dtype=np.float32)
    hidden = np.zeros((pairs, height, width), dtype=np.bool_)
    everywhere = (0, height, 0, width)
    for k in range(pairs):
        poses = (positions[k], quaternions[k], positions[k + 1], quaternions[k + 1])
        view = (eye, rotation, float(camera.fov_y_deg))
        exact_flow_frame(*poses, *view, rendering.mask[k], rendering.depth[k], everywhere, flow[k])
        if with_hidden:
            hidden_frame(kinds, half_sizes, *poses, *view, plane, rendering.mask[k], rendering.depth[k], hidden[k])
    return ExactFlow(flow, hidden)
