"""Exact optical flow of rigid bodies: each visible surface point is moved with its body and projected again.

Flow k is the displacement in px, x right and y down, from frame k to frame k + 1, at the pixels that show an object
in frame k. It is zero elsewhere because the camera does not move, and zero for points that move behind the camera.
Occlusion is ignored: a point that is hidden in frame k + 1 has the flow of its surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.compiled import kernel
from pipeline.scene.scene import FixedBody, SceneObject
from pipeline.vision.rendering.camera import Pinhole
from pipeline.vision.rendering.rasteriser import Rendering, camera_frame, rasterise


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
    """Fill the flow of one pair of frames at the pixels of objects.

    Args:
        position_a: (N, 3) m, in the first frame.
        quaternion_a: (N, 4), in the first frame.
        position_b: (N, 3) m, in the second frame.
        quaternion_b: (N, 4), in the second frame.
        camera_position: (3,) m.
        camera_rotation: (3, 3), columns right, up, back.
        fov_y_deg: Vertical field of view.
        mask: (H, W) of the first frame, from `rasterise_frame`.
        depth: (H, W) of the first frame, from `rasterise_frame`, m.
        within: The rectangle that `rasterise_frame` returned for the first frame.
        flow: float32 (H, W, 2), output, px.
    """
    height, width = mask.shape
    focal = height / (2.0 * math.tan(math.radians(fov_y_deg) * 0.5))
    count = position_a.shape[0]
    motion = np.empty((count, 3, 3))  # of points in the camera frame, from the first to the second pose
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


def exact_flow(
    objects: Sequence[SceneObject],
    positions: np.ndarray,
    quaternions: np.ndarray,
    camera: Pinhole,
    width: int,
    height: int,
    ground: float | None = 0.0,
    rendering: Rendering | None = None,
    fixed: Sequence[FixedBody] = (),
) -> np.ndarray:
    """Flow float32 (F - 1, H, W, 2), px, between consecutive frames.

    Args:
        objects: N objects of analytic shapes.
        positions: (F, N, 3) m.
        quaternions: (F, N, 4) wxyz.
        camera: The camera.
        width: Width of the image, px.
        height: Height of the image, px.
        ground: Height of the ground plane, m; None for no ground.
        rendering: `rasterise` of the same frames, if the caller has it; ground and fixed bodies are then not read.
        fixed: Bodies that do not move.

    Raises:
        SceneError: A body is a mesh.
    """
    if rendering is None:
        rendering = rasterise(objects, positions, quaternions, camera, width, height, ground, fixed)
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    quaternions = np.ascontiguousarray(quaternions, dtype=np.float64)
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    pairs = max(len(positions) - 1, 0)
    flow = np.zeros((pairs, height, width, 2), dtype=np.float32)
    for k in range(pairs):
        exact_flow_frame(
            position_a=positions[k],
            quaternion_a=quaternions[k],
            position_b=positions[k + 1],
            quaternion_b=quaternions[k + 1],
            camera_position=eye,
            camera_rotation=rotation,
            fov_y_deg=float(camera.fov_y_deg),
            mask=rendering.mask[k],
            depth=rendering.depth[k],
            within=(0, height, 0, width),
            flow=flow[k],
        )
    return flow
