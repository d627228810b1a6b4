"""Support functions of the silhouettes of convex solids, in closed form, and distances of points to them.

The silhouette of a convex solid is convex, so its support function describes it fully: h(n) is the largest n·u over
its points u, in units of the focal length. A plane a·x = 0 through the camera, a = (n, h), touches the solid where its
outline has the normal n. For an ellipsoid with centre c and covariance Q that is (a·c)² = aᵀ Q a; the shapes are the
convex hulls of points, discs and spheres.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import kernel
from pipeline.vision.rendering.surface import BOX, CYLINDER

DIRECTIONS = 72  # normals at which a silhouette is computed
_ANGLES = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
NORMALS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)  # unit vectors, right and up
LEAST_DEPTH = 1e-3  # m


@kernel
def fill_support(kind: int, half: np.ndarray, rotation: np.ndarray, centre: np.ndarray, out: np.ndarray) -> bool:
    """Write the support function of a silhouette at `NORMALS` into out (D,); returns whether the solid is in front of
    the camera.

    Args:
        kind: Code of a sphere, cylinder or box, from `surface.KINDS`.
        half: Half extents (3,) m.
        rotation: (3, 3) from the body frame to the camera frame (right, up, back).
        centre: (3,) m, in the camera frame.
        out: Output (D,).
    """
    if kind == BOX:
        x, y = np.empty(8), np.empty(8)
        for piece in range(8):
            sx = half[0] if piece & 1 else -half[0]
            sy = half[1] if piece & 2 else -half[1]
            sz = half[2] if piece & 4 else -half[2]
            depth = -(centre[2] + rotation[2, 0] * sx + rotation[2, 1] * sy + rotation[2, 2] * sz)
            if not depth > LEAST_DEPTH:
                return False
            x[piece] = (centre[0] + rotation[0, 0] * sx + rotation[0, 1] * sy + rotation[0, 2] * sz) / depth
            y[piece] = (centre[1] + rotation[1, 0] * sx + rotation[1, 1] * sy + rotation[1, 2] * sz) / depth
        for d in range(DIRECTIONS):
            best = -np.inf
            for piece in range(8):
                best = max(best, NORMALS[d, 0] * x[piece] + NORMALS[d, 1] * y[piece])
            out[d] = best
        return True
    pieces = 2 if kind == CYLINDER else 1
    square = half[0] * half[0]
    ax, ay, az = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    flat = 1.0 if kind == CYLINDER else 0.0  # of a disc: Q = r² (1 - axis axisᵀ)
    qzz = square * (1.0 - flat * az * az)
    for d in range(DIRECTIONS):
        nx, ny = NORMALS[d, 0], NORMALS[d, 1]
        along = nx * ax + ny * ay
        qnn = square * (1.0 - flat * along * along)
        qnz = -square * flat * along * az
        best = -np.inf
        for piece in range(pieces):
            shift = 0.0
            if pieces == 2:
                shift = half[2] if piece else -half[2]
            cz = centre[2] + shift * az
            if not -cz > LEAST_DEPTH + math.sqrt(max(qzz, 0.0)):
                return False
            cn = nx * (centre[0] + shift * ax) + ny * (centre[1] + shift * ay)
            # (cn + h cz)² = qnn + 2 h qnz + h² qzz, the larger root
            a = cz * cz - qzz
            b = qnz - cn * cz
            c = cn * cn - qnn
            root = math.sqrt(max(b * b - a * c, 0.0))
            best = max(best, (b + root) / a)
        out[d] = best
    return True


@kernel
def fill_distances(points: np.ndarray, count: int, focal: float, support: np.ndarray, distance: np.ndarray,
                   nearest: np.ndarray) -> None:  # fmt: skip
    """Signed distances of points to a silhouette, positive outside.

    Args:
        points: (P, 2) px from the centre of the image, right and up.
        count: How many of them are used.
        focal: Focal length, px.
        support: (D,) from `fill_support`.
        distance: Output (P,) px; far from corners the distance, beyond a corner less than it.
        nearest: Output (P,): the one of `NORMALS` at which the distance was measured.
    """
    for i in range(count):
        best, at = -np.inf, 0
        x, y = points[i, 0], points[i, 1]
        for d in range(DIRECTIONS):
            value = NORMALS[d, 0] * x + NORMALS[d, 1] * y - focal * support[d]
            if value > best:
                best, at = value, d
        distance[i], nearest[i] = best, at
