"""Ray intersections and normals of the five analytic shapes, and of the plane.

Everything is in the body frame, in m. Half extents (hx, hy, hz) are those of `scene.half_extents`; a capsule's include
its caps. The axis of cylinders and capsules is z. A plane is z = 0 and, as in MuJoCo, seen from above only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.compiled import kernel
from pipeline.errors import SceneError
from pipeline.scene.scene import SIZE_KEYS, FixedBody, SceneObject, half_extents

SPHERE, CYLINDER, BOX, CAPSULE, ELLIPSOID, PLANE = range(6)
#: Code of each shape that has an analytic surface: its position in `SIZE_KEYS`.
KINDS: dict[str, int] = {shape: code for code, shape in enumerate(SIZE_KEYS) if code <= ELLIPSOID}
assert [KINDS[s] for s in ("sphere", "cylinder", "box", "capsule", "ellipsoid")] == list(range(5))

_TINY = 1e-14


#: Code of each shape that a fixed body may have.
FIXED_KINDS: dict[str, int] = {**KINDS, "plane": PLANE}


def shape_arrays(objects: Sequence[SceneObject]) -> tuple[np.ndarray, np.ndarray]:
    """Codes int64 (N,) and half extents float64 (N, 3) m of objects. Raises SceneError where an object is a mesh."""
    return _arrays(objects, KINDS, "objects")


def fixed_arrays(fixed: Sequence[FixedBody]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Codes int64 (M,), half extents (M, 3) m, positions (M, 3) m and quaternions (M, 4) of fixed bodies.

    Raises SceneError where one is a mesh.
    """
    position = np.array([b.position for b in fixed], dtype=np.float64).reshape(len(fixed), 3)
    quaternion = np.array([b.orientation for b in fixed], dtype=np.float64).reshape(len(fixed), 4)
    return (*_arrays(fixed, FIXED_KINDS, "fixed"), position, quaternion)


def _arrays(
    bodies: Sequence[SceneObject | FixedBody], kinds: dict[str, int], key: str
) -> tuple[np.ndarray, np.ndarray]:
    """Codes and half extents; key: of the bodies in the scene's text, for the error message."""
    for i, body in enumerate(bodies):
        if body.shape not in kinds:
            raise SceneError(f"{key}[{i}].shape: {body.shape} has no analytic surface; {', '.join(kinds)} have")
    half_sizes = np.array([half_extents(b) for b in bodies], dtype=np.float64).reshape(len(bodies), 3)
    return np.array([kinds[b.shape] for b in bodies], dtype=np.int64), half_sizes


@kernel
def _quadratic(a: float, b: float, c: float) -> tuple[float, float]:
    """The roots of a t² + 2 b t + c in increasing order; (inf, -inf) where there are none."""
    discriminant = b * b - a * c
    if discriminant < 0.0 or a < _TINY * _TINY:
        return np.inf, -np.inf
    root = math.sqrt(discriminant)
    return (-b - root) / a, (-b + root) / a


@kernel
def _slab(o: float, d: float, half: float) -> tuple[float, float]:
    """The interval of t in which |o + t d| <= half; (inf, -inf) where it is empty."""
    if abs(d) < _TINY:
        if abs(o) <= half:
            return -np.inf, np.inf
        return np.inf, -np.inf
    inverse = 1.0 / d
    near = (-half - o) * inverse
    far = (half - o) * inverse
    if near > far:
        return far, near
    return near, far


@kernel
def intersect(
    kind: int, hx: float, hy: float, hz: float, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> float:
    """The smallest t >= 0 at which the ray o + t d meets the surface; inf where it misses.

    The shapes are convex, so a ray is inside for one interval of t. A ray that starts inside meets the surface where
    it leaves, as in MuJoCo's `mj_ray`.

    Args:
        kind: Code of the shape.
        hx, hy, hz: Half extents, m.
        ox, oy, oz: Origin of the ray, m.
        dx, dy, dz: Direction of the ray, of any length.
    """
    enter, leave = np.inf, -np.inf
    if kind == SPHERE:
        enter, leave = _quadratic(
            dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - hx * hx
        )
    elif kind == BOX:
        x0, x1 = _slab(ox, dx, hx)
        y0, y1 = _slab(oy, dy, hy)
        z0, z1 = _slab(oz, dz, hz)
        enter = max(x0, y0, z0)
        leave = min(x1, y1, z1)
    elif kind == CYLINDER:
        a = dx * dx + dy * dy
        c = ox * ox + oy * oy - hx * hx
        if a < _TINY * _TINY:  # parallel to the axis
            r0, r1 = (-np.inf, np.inf) if c <= 0.0 else (np.inf, -np.inf)
        else:
            r0, r1 = _quadratic(a, ox * dx + oy * dy, c)
        z0, z1 = _slab(oz, dz, hz)
        enter = max(r0, z0)
        leave = min(r1, z1)
    elif kind == CAPSULE:
        # A convex union of a cylinder and two spheres: its interval is the hull of their three intervals.
        a = dx * dx + dy * dy
        b = ox * dx + oy * dy
        c = ox * ox + oy * oy - hx * hx
        if b * b >= a * c:  # otherwise the ray misses even the infinite cylinder
            length = hz - hx
            if a >= _TINY * _TINY:
                r0, r1 = _quadratic(a, b, c)
                z0, z1 = _slab(oz, dz, length)
                if max(r0, z0) <= min(r1, z1):
                    enter = max(r0, z0)
                    leave = min(r1, z1)
            for end in (-length, length):
                s = oz - end
                s0, s1 = _quadratic(a + dz * dz, b + s * dz, c + s * s)
                enter = min(enter, s0)
                leave = max(leave, s1)
    elif kind == ELLIPSOID:
        ox, oy, oz, dx, dy, dz = ox / hx, oy / hy, oz / hz, dx / hx, dy / hy, dz / hz
        enter, leave = _quadratic(
            dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1.0
        )
    elif kind == PLANE and oz >= 0.0 and dz < -_TINY:
        enter = leave = -oz / dz
    if not (enter <= leave and leave >= 0.0):
        return np.inf
    return enter if enter >= 0.0 else leave


@kernel
def normal(kind: int, hx: float, hy: float, hz: float, px: float, py: float, pz: float) -> tuple[float, float, float]:
    """The outward unit normal at the surface point p; on the edge of a box or cylinder, that of one adjacent face."""
    nx, ny, nz = px, py, pz
    if kind == BOX:
        x, y, z = abs(px) / hx, abs(py) / hy, abs(pz) / hz
        nx = math.copysign(1.0, px) if x >= y and x >= z else 0.0
        ny = math.copysign(1.0, py) if nx == 0.0 and y >= z else 0.0
        nz = math.copysign(1.0, pz) if nx == 0.0 and ny == 0.0 else 0.0
        return nx, ny, nz
    if kind == CYLINDER:
        if abs(pz) * hx >= math.sqrt(px * px + py * py) * hz:
            return 0.0, 0.0, math.copysign(1.0, pz)
        nz = 0.0
    elif kind == CAPSULE:
        length = hz - hx
        nz = pz - min(max(pz, -length), length)
    elif kind == ELLIPSOID:
        nx, ny, nz = px / (hx * hx), py / (hy * hy), pz / (hz * hz)
    elif kind == PLANE:
        return 0.0, 0.0, 1.0
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale
