"""Ray queries of the shading kernels: the nearest hit, the visible share of a light, and ambient occlusion.

`body` is the table of `pipeline.vision.rendering.shading_tables`.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import inlined_kernel
from pipeline.vision.rendering.shading_tables import AXES, CENTRE, DISC, HALF, KIND, NEAR, RADIUS, TOWARDS
from pipeline.vision.rendering.surface import intersect

FLOOR, SKY = -1, -2
_SHADOW_SAMPLES = 8
#: Points of the unit disc that are sampled for soft shadows: a golden-angle spiral.
_DISC = np.array(
    [
        (
            math.sqrt((k + 0.5) / _SHADOW_SAMPLES) * math.cos(2.399963 * k),
            math.sqrt((k + 0.5) / _SHADOW_SAMPLES) * math.sin(2.399963 * k),
        )
        for k in range(_SHADOW_SAMPLES)
    ]
)


@inlined_kernel
def intersect_body(body: np.ndarray, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Ray parameter t at which the ray o + t d (world frame) meets body i; inf where it misses."""
    x, y, z = ox - body[i, CENTRE], oy - body[i, CENTRE + 1], oz - body[i, CENTRE + 2]
    return intersect(
        int(body[i, KIND]),
        body[i, HALF],
        body[i, HALF + 1],
        body[i, HALF + 2],
        body[i, AXES] * x + body[i, AXES + 3] * y + body[i, AXES + 6] * z,
        body[i, AXES + 1] * x + body[i, AXES + 4] * y + body[i, AXES + 7] * z,
        body[i, AXES + 2] * x + body[i, AXES + 5] * y + body[i, AXES + 8] * z,
        body[i, AXES] * dx + body[i, AXES + 3] * dy + body[i, AXES + 6] * dz,
        body[i, AXES + 1] * dx + body[i, AXES + 4] * dy + body[i, AXES + 7] * dz,
        body[i, AXES + 2] * dx + body[i, AXES + 5] * dy + body[i, AXES + 8] * dz,
    )


@inlined_kernel
def nearest_hit(
    body: np.ndarray, ground: float, skip: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[int, float]:
    """What a ray with unit direction d meets first, a body, FLOOR or SKY, and its distance. Body `skip` is ignored."""
    found, best = SKY, np.inf
    if dz < 0.0 and oz >= ground:
        found, best = FLOOR, (ground - oz) / dz
    for i in range(body.shape[0]):
        if i == skip:
            continue
        x, y, z = body[i, CENTRE] - ox, body[i, CENTRE + 1] - oy, body[i, CENTRE + 2] - oz
        along = x * dx + y * dy + z * dz
        if x * x + y * y + z * z - along * along > body[i, RADIUS] ** 2 or along < -body[i, RADIUS]:
            continue
        t = intersect_body(body, i, ox, oy, oz, dx, dy, dz)
        if t < best:
            found, best = i, t
    return found, best


@inlined_kernel
def visible_share(body: np.ndarray, light: np.ndarray, k: int, skip: int, px: float, py: float, pz: float) -> float:
    """Share of the disc of light k that is visible from point p.

    Body `skip`, on whose surface the point is, is ignored: a convex body never hides what its normal faces.
    """
    lx, ly, lz = light[k, TOWARDS], light[k, TOWARDS + 1], light[k, TOWARDS + 2]
    reach = np.inf
    radius = light[k, DISC]
    if light[k, NEAR] != 0.0:
        lx, ly, lz = lx - px, ly - py, lz - pz
        reach = math.sqrt(lx * lx + ly * ly + lz * lz)
        lx, ly, lz = lx / reach, ly / reach, lz / reach
        radius /= reach
    # Two unit vectors orthogonal to the ray.
    if abs(lx) < 0.6:
        ax, ay, az = 0.0, lz, -ly
    else:
        ax, ay, az = -lz, 0.0, lx
    scale = 1.0 / math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * scale, ay * scale, az * scale
    bx, by, bz = ly * az - lz * ay, lz * ax - lx * az, lx * ay - ly * ax
    samples = _SHADOW_SAMPLES if radius > 0.0 else 1
    blocked = 0
    for i in range(body.shape[0]):
        if i == skip:
            continue
        x, y, z = body[i, CENTRE] - px, body[i, CENTRE + 1] - py, body[i, CENTRE + 2] - pz
        along = x * lx + y * ly + z * lz
        wide = body[i, RADIUS] + radius * max(along, 0.0)
        if along < -body[i, RADIUS] or x * x + y * y + z * z - along * along > wide * wide:
            continue
        for m in range(samples):
            if blocked & (1 << m):
                continue
            u, v = radius * _DISC[m, 0], radius * _DISC[m, 1]
            if samples == 1:
                u, v = 0.0, 0.0
            t = intersect_body(body, i, px, py, pz, lx + u * ax + v * bx, ly + u * ay + v * by, lz + u * az + v * bz)
            if t < reach:
                blocked |= 1 << m
    free = 0
    for m in range(samples):
        free += 1 - ((blocked >> m) & 1)
    return free / samples


@inlined_kernel
def ambient_occlusion(
    body: np.ndarray, moving: int, skip: int, px: float, py: float, pz: float, nx: float, ny: float, nz: float
) -> float:
    """Share of the ambient light that other bodies, approximated by spheres, leave at point p with normal n.

    Only the first `moving` bodies count: a long ramp or a wall is no sphere.
    """
    open_share = 1.0
    for i in range(moving):
        if i == skip:
            continue
        radius = (body[i, HALF] + body[i, HALF + 1] + body[i, HALF + 2]) / 3.0
        x, y, z = body[i, CENTRE] - px, body[i, CENTRE + 1] - py, body[i, CENTRE + 2] - pz
        squared = x * x + y * y + z * z
        if squared > 16.0 * radius * radius:
            continue
        distance = math.sqrt(max(squared, radius * radius))
        facing = 0.5 + 0.5 * (x * nx + y * ny + z * nz) / distance
        open_share *= 1.0 - max(facing, 0.0) * ((radius / distance) ** 2 - 0.0625) / 0.9375
    return max(open_share, 0.2)
