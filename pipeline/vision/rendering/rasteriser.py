"""Instance masks and planar depth of moving analytic shapes, by ray casting. The inner loop of the searches.

One ray is cast through the centre of each pixel. Rays are (x, y, -1) in the camera frame, so the ray parameter of a
hit is its planar depth. For each object only the pixels in the bounding rectangle of its projection are visited. What
does not move, ground and fixed bodies, is drawn once, as the background of all frames. The result agrees with
`mj_multiRay` (tests/vision/test_rasteriser.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from pipeline.scene.rotation import fill_matrix
from pipeline.scene.scene import FixedBody, SceneObject
from pipeline.vision.rendering.camera import Pinhole
from pipeline.vision.rendering.surface import (
    BOX,
    CAPSULE,
    CYLINDER,
    PLANE,
    SPHERE,
    fixed_arrays,
    intersect,
    shape_arrays,
)

_NOTHING, _RECTANGLE, _EVERYTHING = range(3)
_MARGIN_PX = 1e-3  # tolerance for rounding errors of the rectangle


@dataclass(frozen=True)
class Rendering:
    """Masks and depths of F frames.

    Attributes:
        mask: uint8 (F, H, W): i + 1 where object i is nearest, 0 for ground, fixed bodies and background.
        depth: float32 (F, H, W): planar depth of objects, ground and fixed bodies, m; inf for the background.
    """

    mask: np.ndarray
    depth: np.ndarray


@kernel
def camera_frame(
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    out: np.ndarray,
) -> None:
    """The camera in the body frame, written into out (4, 3): rows right, up, back and centre (m).

    position (3,) m and quaternion (4,) are the pose of the body.
    """
    body = np.empty((3, 3))
    fill_matrix(quaternion, body)
    for j in range(3):
        for row in range(3):
            out[row, j] = (
                body[0, j] * camera_rotation[0, row]
                + body[1, j] * camera_rotation[1, row]
                + body[2, j] * camera_rotation[2, row]
            )
        out[3, j] = (
            body[0, j] * (camera_position[0] - position[0])
            + body[1, j] * (camera_position[1] - position[1])
            + body[2, j] * (camera_position[2] - position[2])
        )


@kernel
def bounds(kind: int, half: np.ndarray, view: np.ndarray) -> tuple[int, float, float, float, float]:
    """Bounding rectangle of a shape's projection: one of the three codes above, then x0, x1, y0, y1 of rays (x, y, -1).

    view: (4, 3), from `camera_frame`. Each shape is the convex hull of a few ellipsoids, possibly degenerate: the
    corners of a box, the two discs of a cylinder, the two spheres of a capsule. An ellipsoid with centre c and
    covariance Q is bounded by its tangent planes through the camera, (c_x - u c_z)² = Q_xx - 2 u Q_xz + u² Q_zz.
    """
    if kind == PLANE:
        return _EVERYTHING, 0.0, 0.0, 0.0, 0.0
    pieces, reach = 1, 0.0
    if kind == BOX:
        pieces = 8
    elif kind == CYLINDER:
        pieces, reach = 2, half[2]
    elif kind == CAPSULE:
        pieces, reach = 2, half[2] - half[0]
    # Variances along the body axes.
    wx, wy, wz = half[0] * half[0], half[1] * half[1], half[2] * half[2]
    if kind == BOX:
        wx, wy, wz = 0.0, 0.0, 0.0
    elif kind == CYLINDER:
        wz = 0.0
    elif kind in (CAPSULE, SPHERE):
        wy, wz = wx, wx
    qzz = wx * view[2, 0] ** 2 + wy * view[2, 1] ** 2 + wz * view[2, 2] ** 2
    thickness = math.sqrt(qzz)
    near, far = np.inf, -np.inf
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for piece in range(pieces):
        px, py, pz = 0.0, 0.0, 0.0
        if kind == BOX:
            px = half[0] if piece & 1 else -half[0]
            py = half[1] if piece & 2 else -half[1]
            pz = half[2] if piece & 4 else -half[2]
        elif pieces == 2:
            pz = reach if piece else -reach
        px -= view[3, 0]
        py -= view[3, 1]
        pz -= view[3, 2]
        cz = -(view[2, 0] * px + view[2, 1] * py + view[2, 2] * pz)
        near = min(near, cz - thickness)
        far = max(far, cz + thickness)
        if near <= 1e-9:
            continue
        a = cz * cz - qzz
        for axis in range(2):
            c = view[axis, 0] * px + view[axis, 1] * py + view[axis, 2] * pz
            q = wx * view[axis, 0] ** 2 + wy * view[axis, 1] ** 2 + wz * view[axis, 2] ** 2
            cross = -(
                wx * view[axis, 0] * view[2, 0] + wy * view[axis, 1] * view[2, 1] + wz * view[axis, 2] * view[2, 2]
            )
            b = c * cz - cross
            root = math.sqrt(max(b * b - a * (c * c - q), 0.0))
            if axis == 0:
                x0 = min(x0, (b - root) / a)
                x1 = max(x1, (b + root) / a)
            else:
                y0 = min(y0, (b - root) / a)
                y1 = max(y1, (b + root) / a)
    if not far > 0.0:  # also where the pose is NaN
        return _NOTHING, 0.0, 0.0, 0.0, 0.0
    if near <= 1e-9:
        return _EVERYTHING, 0.0, 0.0, 0.0, 0.0
    if not (x0 <= x1 and y0 <= y1):
        return _NOTHING, 0.0, 0.0, 0.0, 0.0
    return _RECTANGLE, x0, x1, y0, y1


@kernel
def pixel_range(low: float, high: float, count: int) -> tuple[int, int]:
    """First pixel whose centre lies within [low, high] px, and one past the last."""
    first = math.ceil(min(max(low - 0.5 - _MARGIN_PX, 0.0), float(count)))
    last = math.floor(min(max(high - 0.5 + _MARGIN_PX, -1.0), count - 1.0))
    return int(first), int(last) + 1


@kernel
def pixel_rectangle(
    kind: int, half: np.ndarray, view: np.ndarray, focal: float, width: int, height: int
) -> tuple[int, int, int, int]:
    """The pixels that a shape can cover: first column, one past the last column, first row, one past the last row.

    view: (4, 3), from `camera_frame`.
    """
    covers, x0, x1, y0, y1 = bounds(kind, half, view)
    if covers == _NOTHING:
        return 0, 0, 0, 0
    if covers == _EVERYTHING:
        return 0, width, 0, height
    col0, col1 = pixel_range(0.5 * width + focal * x0, 0.5 * width + focal * x1, width)
    row0, row1 = pixel_range(0.5 * height - focal * y1, 0.5 * height - focal * y0, height)
    return col0, col1, row0, row1


@kernel
def fill_background(
    camera_position: np.ndarray, camera_rotation: np.ndarray, fov_y_deg: float, ground: float, depth: np.ndarray
) -> None:
    """Write the planar depth of the ground into depth (H, W), inf where it is not visible.

    ground: height, m, or nan for none. As in MuJoCo the plane is visible from above only.
    """
    height, width = depth.shape
    depth[:] = np.inf
    drop = ground - camera_position[2]
    if not drop <= 0.0:
        return
    focal = height / (2.0 * math.tan(math.radians(fov_y_deg) * 0.5))
    for row in range(height):
        y = (0.5 * height - row - 0.5) / focal
        dz = camera_rotation[2, 1] * y - camera_rotation[2, 2]
        for col in range(width):
            fall = dz + camera_rotation[2, 0] * ((col + 0.5 - 0.5 * width) / focal)
            if fall < -1e-14:
                depth[row, col] = drop / fall


@kernel
def rasterise_frame(
    kinds: np.ndarray,
    half_sizes: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov_y_deg: float,
    background: np.ndarray,
    mask: np.ndarray,
    depth: np.ndarray,
) -> tuple[int, int, int, int]:
    """Fill the mask and the depth of one frame.

    Args:
        kinds: int64 (N,), codes of `surface.KINDS`.
        half_sizes: (N, 3) m.
        position: (N, 3) m.
        quaternion: (N, 4).
        camera_position: (3,) m.
        camera_rotation: (3, 3), columns right, up, back.
        fov_y_deg: Vertical field of view.
        background: float32 (H, W), from `fill_background` and `draw_fixed`; it depends on camera, ground and fixed
            bodies only.
        mask: uint8 (H, W), output.
        depth: float32 (H, W), output, m.

    Returns:
        The rectangle outside which there is no object: first row, one past the last row, first column, one past the
        last column.
    """
    height, width = mask.shape
    mask[:] = 0
    depth[:] = background
    top, bottom, left, right = height, 0, width, 0
    focal = height / (2.0 * math.tan(math.radians(fov_y_deg) * 0.5))
    view = np.empty((4, 3))
    for i in range(kinds.shape[0]):
        camera_frame(position[i], quaternion[i], camera_position, camera_rotation, view)
        kind = kinds[i]
        col0, col1, row0, row1 = pixel_rectangle(kind, half_sizes[i], view, focal, width, height)
        if col0 >= col1 or row0 >= row1:
            continue
        top, bottom, left, right = min(top, row0), max(bottom, row1), min(left, col0), max(right, col1)
        hx, hy, hz = half_sizes[i, 0], half_sizes[i, 1], half_sizes[i, 2]
        ox, oy, oz = view[3, 0], view[3, 1], view[3, 2]
        rx, ry, rz = view[0, 0], view[0, 1], view[0, 2]
        inverse = 1.0 / focal
        for row in range(row0, row1):
            y = (0.5 * height - row - 0.5) * inverse
            ax = y * view[1, 0] - view[2, 0]
            ay = y * view[1, 1] - view[2, 1]
            az = y * view[1, 2] - view[2, 2]
            for col in range(col0, col1):
                x = (col + 0.5 - 0.5 * width) * inverse
                t = intersect(kind, hx, hy, hz, ox, oy, oz, ax + x * rx, ay + x * ry, az + x * rz)
                if t < depth[row, col]:
                    depth[row, col] = t
                    mask[row, col] = i + 1
    return top, max(bottom, top), left, max(right, left)


@kernel
def draw_fixed(
    kinds: np.ndarray,
    half_sizes: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov_y_deg: float,
    scratch: np.ndarray,
    depth: np.ndarray,
) -> None:
    """Draw fixed bodies into the depth (H, W) of `fill_background`.

    Args:
        kinds: int64 (M,), codes of `surface.FIXED_KINDS`.
        half_sizes: (M, 3) m.
        position: (M, 3) m.
        quaternion: (M, 4).
        camera_position: (3,) m.
        camera_rotation: (3, 3), columns right, up, back.
        fov_y_deg: Vertical field of view.
        scratch: uint8 (H, W), work space.
        depth: float32 (H, W), changed, m.
    """
    if len(kinds):
        rasterise_frame(
            kinds, half_sizes, position, quaternion, camera_position, camera_rotation, fov_y_deg, depth, scratch, depth
        )


def background_depth(
    camera: Pinhole, width: int, height: int, ground: float | None, fixed: Sequence[FixedBody]
) -> np.ndarray:
    """Planar depth float32 (H, W) m of what does not move; inf where there is nothing.

    Args:
        camera: The camera.
        width: Width of the image, px.
        height: Height of the image, px.
        ground: Height of the ground plane, m; None for no ground.
        fixed: Bodies that do not move.

    Raises:
        SceneError: A fixed body is a mesh.
    """
    depth = np.empty((height, width), dtype=np.float32)
    scratch = np.empty((height, width), dtype=np.uint8)
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    fov = float(camera.fov_y_deg)
    fill_background(eye, rotation, fov, math.nan if ground is None else float(ground), depth)
    draw_fixed(*fixed_arrays(fixed), eye, rotation, fov, scratch, depth)
    return depth


@kernel
def rasterise_frames(
    kinds: np.ndarray,
    half_sizes: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov_y_deg: float,
    background: np.ndarray,
    mask: np.ndarray,
    depth: np.ndarray,
) -> None:
    """`rasterise_frame` for F frames of one camera: position (F, N, 3), quaternion (F, N, 4), mask, depth (F, H, W)."""
    for frame in range(mask.shape[0]):
        rasterise_frame(
            kinds,
            half_sizes,
            position[frame],
            quaternion[frame],
            camera_position,
            camera_rotation,
            fov_y_deg,
            background,
            mask[frame],
            depth[frame],
        )


def rasterise(
    objects: Sequence[SceneObject],
    positions: np.ndarray,
    quaternions: np.ndarray,
    camera: Pinhole,
    width: int,
    height: int,
    ground: float | None = 0.0,
    fixed: Sequence[FixedBody] = (),
) -> Rendering:
    """Masks and depths of F frames.

    Args:
        objects: N objects of analytic shapes.
        positions: (F, N, 3) m.
        quaternions: (F, N, 4) wxyz.
        camera: The camera.
        width: Width of the image, px.
        height: Height of the image, px.
        ground: Height of the ground plane, m; None for no ground.
        fixed: Bodies that do not move; they hide what is behind them.

    Raises:
        SceneError: A body is a mesh.
    """
    assert len(objects) < 256, "a uint8 mask holds at most 255 objects"
    kinds, half_sizes = shape_arrays(objects)
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    quaternions = np.ascontiguousarray(quaternions, dtype=np.float64)
    frames = len(positions)
    assert positions.shape == (frames, len(objects), 3)
    assert quaternions.shape == (frames, len(objects), 4)
    mask = np.empty((frames, height, width), dtype=np.uint8)
    depth = np.empty((frames, height, width), dtype=np.float32)
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    background = background_depth(camera, width, height, ground, fixed)
    rasterise_frames(
        kinds, half_sizes, positions, quaternions, eye, rotation, float(camera.fov_y_deg), background, mask, depth
    )
    return Rendering(mask, depth)
