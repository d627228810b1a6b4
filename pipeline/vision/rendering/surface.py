"""Ray intersections and normals of the five analytic shapes.

Everything is in the body frame, in m. Half extents (hx, hy, hz) are those of `scene.half_extents`; a capsule's include
its caps. The axis of cylinders and capsules is z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.compiled import kernel
from pipeline.errors import SceneError
from pipeline.scene.scene import SIZE_KEYS, SceneObject, half_extents

SPHERE, CYLINDER, BOX, CAPSULE, ELLIPSOID = range(5)
#: Code of each shape that has an analytic surface: its position in `SIZE_KEYS`.
KINDS: dict[str, int] = {shape: code for code, shape in enumerate(SIZE_KEYS) if code <= ELLIPSOID}
assert [KINDS[s] for s in ("sphere", "cylinder", "box", "capsule", "ellipsoid")] == list(range(5))

_TINY = 1e-14


def shape_arrays(objects: Sequence[SceneObject]) -> tuple[np.ndarray, np.ndarray]:
    """Codes int64 (N,) and half extents float64 (N, 3) m of objects. Raises SceneError where an object is a mesh."""
    for i, obj in enumerate(objects):
        if obj.shape not in KINDS:
            raise SceneError(f"objects[{i}].shape: {obj.shape} has no analytic surface; {', '.join(KINDS)} have")
    half_sizes = np.array([half_extents(o) for o in objects], dtype=np.float64).reshape(len(objects), 3)
    return np.array([KINDS[o.shape] for o in objects], dtype=np.int64), half_sizes


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
    scale = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale
