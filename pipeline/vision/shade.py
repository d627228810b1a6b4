"""A shaded ray caster: RGB pictures of analytic shapes on a floor, without OpenGL.

Lambert and Blinn-Phong shading, shadow rays, one mirror reflection, procedural textures that turn with the body,
and four rays where neighbouring pixels differ much. Colours are added up as displayed, without a gamma, as MuJoCo's
renderer does. Deterministic: the same arguments give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.compiled import inlined_kernel, kernel
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import SceneObject
from pipeline.scene.solid import bounding_radii
from pipeline.vision.appearance import Appearance
from pipeline.vision.camera import Pinhole, focal_px
from pipeline.vision.look import (
    AMBIENT,
    AXES,
    CENTRE,
    COLOUR,
    DISC,
    GROUND,
    HALF,
    HAZE,
    KIND,
    LIGHT,
    MIRROR,
    NEAR,
    RADIUS,
    RGB,
    SCALE,
    SECOND,
    SEED,
    SHADOWS,
    SHININESS,
    SPECULAR,
    TEXTURE,
    TOWARDS,
    look_tables,
    sky,
    store,
)
from pipeline.vision.rasteriser import fill_background, rasterise_frame
from pipeline.vision.surface import intersect, normal, shape_arrays
from pipeline.vision.texture import texture

FLOOR, SKY = -1, -2
_CONTRAST = 20  # of 255, between neighbours: from here on a pixel gets four rays
_LIT_CONTRAST = 0.3  # lights, likewise
_SHADOW_SAMPLES = 8
#: Points of the unit disc that a soft shadow samples: a spiral by the golden angle.
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
def _meets(body: np.ndarray, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """t of the ray o + t d (world) on body i; inf where it misses."""
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
def _nearest(
    body: np.ndarray, ground: float, skip: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[int, float]:
    """What a ray with a unit direction meets first, and at which distance. Body `skip` is passed over."""
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
        t = _meets(body, i, ox, oy, oz, dx, dy, dz)
        if t < best:
            found, best = i, t
    return found, best


@inlined_kernel
def _lit_share(body: np.ndarray, light: np.ndarray, k: int, skip: int, px: float, py: float, pz: float) -> float:
    """Share of a light's disc that a point sees. The shapes are convex: body `skip`, the point's own, never hides
    what its normal faces."""
    lx, ly, lz = light[k, TOWARDS], light[k, TOWARDS + 1], light[k, TOWARDS + 2]
    reach = np.inf
    radius = light[k, DISC]
    if light[k, NEAR] != 0.0:
        lx, ly, lz = lx - px, ly - py, lz - pz
        reach = math.sqrt(lx * lx + ly * ly + lz * lz)
        lx, ly, lz = lx / reach, ly / reach, lz / reach
        radius /= reach
    # Two directions across the ray.
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
            t = _meets(body, i, px, py, pz, lx + u * ax + v * bx, ly + u * ay + v * by, lz + u * az + v * bz)
            if t < reach:
                blocked |= 1 << m
    free = 0
    for m in range(samples):
        free += 1 - ((blocked >> m) & 1)
    return free / samples


@inlined_kernel
def _openness(body: np.ndarray, skip: int, px: float, py: float, pz: float, nx: float, ny: float, nz: float) -> float:
    """Share of the light from everywhere that is left near other body, each taken as a sphere."""
    open_share = 1.0
    for i in range(body.shape[0]):
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


@inlined_kernel
def _surface(
    body: np.ndarray,
    material: np.ndarray,
    light: np.ndarray,
    world: np.ndarray,
    shadows: bool,
    pixel: float,
    i: int,
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
    t: float,
) -> tuple[float, float, float, float, float, float, float]:
    """Colour, normal, and the number of lights that reach it, of what a ray met at point p.

    The ray: unit direction d, t metres long. i: the body, or FLOOR. pixel: the angle that a pixel spans, rad.
    """
    row = i
    if i == FLOOR:
        row = body.shape[0]
        nx, ny, nz = 0.0, 0.0, 1.0
        tx, ty, tz = px, py, 0.0
    else:
        x, y, z = px - body[i, CENTRE], py - body[i, CENTRE + 1], pz - body[i, CENTRE + 2]
        tx = body[i, AXES] * x + body[i, AXES + 3] * y + body[i, AXES + 6] * z
        ty = body[i, AXES + 1] * x + body[i, AXES + 4] * y + body[i, AXES + 7] * z
        tz = body[i, AXES + 2] * x + body[i, AXES + 5] * y + body[i, AXES + 8] * z
        mx, my, mz = normal(int(body[i, KIND]), body[i, HALF], body[i, HALF + 1], body[i, HALF + 2], tx, ty, tz)
        nx = body[i, AXES] * mx + body[i, AXES + 1] * my + body[i, AXES + 2] * mz
        ny = body[i, AXES + 3] * mx + body[i, AXES + 4] * my + body[i, AXES + 5] * mz
        nz = body[i, AXES + 6] * mx + body[i, AXES + 7] * my + body[i, AXES + 8] * mz
    facing = -(nx * dx + ny * dy + nz * dz)
    if facing < 0.0:  # seen from inside
        nx, ny, nz, facing = -nx, -ny, -nz, -facing
    mix = texture(
        int(material[row, TEXTURE]),
        material[row, SCALE],
        int(material[row, SEED]),
        tx,
        ty,
        tz,
        pixel * t / math.sqrt(max(facing, 0.01)),
    )
    red = material[row, COLOUR] + mix * (material[row, SECOND] - material[row, COLOUR])
    green = material[row, COLOUR + 1] + mix * (material[row, SECOND + 1] - material[row, COLOUR + 1])
    blue = material[row, COLOUR + 2] + mix * (material[row, SECOND + 2] - material[row, COLOUR + 2])

    around = world[AMBIENT] * (0.75 + 0.25 * nz)
    if shadows:
        around *= _openness(body, i, px, py, pz, nx, ny, nz)
    lit = 0.0
    sum_r, sum_g, sum_b = around * red, around * green, around * blue
    for k in range(light.shape[0]):
        lx, ly, lz = light[k, TOWARDS], light[k, TOWARDS + 1], light[k, TOWARDS + 2]
        if light[k, NEAR] != 0.0:
            lx, ly, lz = lx - px, ly - py, lz - pz
            scale = 1.0 / math.sqrt(lx * lx + ly * ly + lz * lz)
            lx, ly, lz = lx * scale, ly * scale, lz * scale
        lambert = nx * lx + ny * ly + nz * lz
        if lambert <= 0.0:
            continue
        share = _lit_share(body, light, k, i, px, py, pz) if shadows else 1.0
        lit += share
        if share == 0.0:
            continue
        shine = 0.0
        if material[row, SPECULAR] > 0.0:
            hx, hy, hz = lx - dx, ly - dy, lz - dz
            half_way = (nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz)
            if half_way > 0.0:
                shine = material[row, SPECULAR] * half_way ** material[row, SHININESS]
        sum_r += share * light[k, LIGHT] * (lambert * red + shine)
        sum_g += share * light[k, LIGHT + 1] * (lambert * green + shine)
        sum_b += share * light[k, LIGHT + 2] * (lambert * blue + shine)
    return sum_r, sum_g, sum_b, nx, ny, nz, lit


@inlined_kernel
def _haze(world: np.ndarray, t: float, dx: float, dy: float, red: float, green: float, blue: float) -> RGB:
    """A floor's colour, faded into the horizon's with distance."""
    ratio = t / world[HAZE]
    kept = math.exp(-ratio * ratio)
    if kept > 0.999:
        return red, green, blue
    sr, sg, sb = sky(world, dx, dy, 0.0)
    return sr + kept * (red - sr), sg + kept * (green - sg), sb + kept * (blue - sb)


@inlined_kernel
def _colour(
    body: np.ndarray,
    material: np.ndarray,
    light: np.ndarray,
    world: np.ndarray,
    pixel: float,
    i: int,
    t: float,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, float, float, float]:
    """The colour seen along a ray with unit direction d that meets i (a body, FLOOR or SKY) at
    distance t; and the number of lights that reach it."""
    if i == SKY:
        red, green, blue = sky(world, dx, dy, dz)
        return red, green, blue, 0.0
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    red, green, blue, nx, ny, nz, lit = _surface(
        body, material, light, world, world[SHADOWS] != 0.0, pixel, i, px, py, pz, dx, dy, dz, t
    )
    if i == FLOOR:
        red, green, blue = _haze(world, t, dx, dy, red, green, blue)
        return red, green, blue, lit
    mirror = material[i, MIRROR]
    if mirror > 0.0:
        facing = dx * nx + dy * ny + dz * nz
        rx, ry, rz = dx - 2 * facing * nx, dy - 2 * facing * ny, dz - 2 * facing * nz
        mirror += (1.0 - mirror) * 0.5 * (1.0 + facing) ** 4  # Schlick's, weakened
        j, s = _nearest(body, world[GROUND], i, px, py, pz, rx, ry, rz)
        if j == SKY:
            sr, sg, sb = sky(world, rx, ry, rz)
        else:
            sr, sg, sb, _, _, _, _ = _surface(
                body,
                material,
                light,
                world,
                world[SHADOWS] != 0.0,
                pixel,
                j,
                px + s * rx,
                py + s * ry,
                pz + s * rz,
                rx,
                ry,
                rz,
                t + s,
            )
            if j == FLOOR:
                sr, sg, sb = _haze(world, t + s, rx, ry, sr, sg, sb)
        red, green, blue = red + mirror * (sr - red), green + mirror * (sg - green), blue + mirror * (sb - blue)
    return red, green, blue, lit


@kernel
def _differs(picture: np.ndarray, mask: np.ndarray, lit: np.ndarray, row: int, col: int) -> bool:
    """Whether one of a pixel's four neighbours is of another object or light, or on an object, of another colour.

    On the floor the textures' own edges are soft: colour does not count.
    """
    height, width = mask.shape
    for side in range(4):
        r = row + (1 if side == 0 else (-1 if side == 1 else 0))
        c = col + (1 if side == 2 else (-1 if side == 3 else 0))
        if not (0 <= r < height and 0 <= c < width):
            continue
        if mask[r, c] != mask[row, col] or abs(lit[r, c] - lit[row, col]) > _LIT_CONTRAST:
            return True
        if mask[row, col] == 0:
            continue
        for channel in range(3):
            if abs(np.int64(picture[row, col, channel]) - np.int64(picture[r, c, channel])) > _CONTRAST:
                return True
    return False


@kernel
def _shade_frame(
    body: np.ndarray,
    material: np.ndarray,
    light: np.ndarray,
    world: np.ndarray,
    eye: np.ndarray,
    camera: np.ndarray,
    focal: float,
    antialias: bool,
    mask: np.ndarray,
    depth: np.ndarray,
    draft: np.ndarray,
    lit: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out uint8 (H, W, 3) of one frame; mask, depth: its own from `rasterise_frame`; draft: like out, and
    lit: float32 (H, W), to work in."""
    height, width = mask.shape
    pixel = 1.0 / focal
    ox, oy, oz = eye[0], eye[1], eye[2]
    for row in range(height):
        y = (0.5 * height - row - 0.5) / focal
        for col in range(width):
            x = (col + 0.5 - 0.5 * width) / focal
            dx = camera[0, 0] * x + camera[0, 1] * y - camera[0, 2]
            dy = camera[1, 0] * x + camera[1, 1] * y - camera[1, 2]
            dz = camera[2, 0] * x + camera[2, 1] * y - camera[2, 2]
            length = math.sqrt(1.0 + x * x + y * y)
            t = depth[row, col] * length
            i = SKY if t == np.inf else (FLOOR if mask[row, col] == 0 else int(mask[row, col]) - 1)
            red, green, blue, lit[row, col] = _colour(
                body, material, light, world, pixel, i, t, ox, oy, oz, dx / length, dy / length, dz / length
            )
            store(draft, row, col, red, green, blue)
    out[:] = draft
    if not antialias:
        return
    for row in range(height):
        for col in range(width):
            if not _differs(draft, mask, lit, row, col):
                continue
            red, green, blue = 0.0, 0.0, 0.0
            for part in range(4):
                x = (col + (0.25 if part & 1 else 0.75) - 0.5 * width) / focal
                y = (0.5 * height - row - (0.25 if part & 2 else 0.75)) / focal
                length = math.sqrt(1.0 + x * x + y * y)
                dx = (camera[0, 0] * x + camera[0, 1] * y - camera[0, 2]) / length
                dy = (camera[1, 0] * x + camera[1, 1] * y - camera[1, 2]) / length
                dz = (camera[2, 0] * x + camera[2, 1] * y - camera[2, 2]) / length
                i, t = _nearest(body, world[GROUND], SKY, ox, oy, oz, dx, dy, dz)
                r, g, b, _ = _colour(body, material, light, world, 0.5 * pixel, i, t, ox, oy, oz, dx, dy, dz)
                red += min(r, 1.0)
                green += min(g, 1.0)
                blue += min(b, 1.0)
            store(out, row, col, 0.25 * red, 0.25 * green, 0.25 * blue)


def shade(
    objects: Sequence[SceneObject],
    positions: np.ndarray,
    quaternions: np.ndarray,
    camera: Pinhole,
    appearance: Appearance,
    width: int,
    height: int,
    ground: float | None = 0.0,
    shadows: bool = True,
    antialias: bool = True,
) -> np.ndarray:
    """Pictures uint8 (F, H, W, 3): positions (F, N, 3) m, quaternions (F, N, 4) wxyz, ground height m or None.

    Raises SceneError where an object is a mesh.
    """
    assert len(appearance.materials) == len(objects), "an appearance has one material for each object"
    kinds, half_sizes = shape_arrays(objects)
    radius = np.array([bounding_radii(o.shape, half_sizes[[i]])[0] for i, o in enumerate(objects)])
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    quaternions = np.ascontiguousarray(quaternions, dtype=np.float64)
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    fov = float(camera.fov_y_deg)
    plane = math.nan if ground is None else float(ground)
    look = look_tables(appearance, plane, shadows)
    out = np.empty((len(positions), height, width, 3), dtype=np.uint8)
    draft = np.empty((height, width, 3), dtype=np.uint8)
    lit = np.empty((height, width), dtype=np.float32)
    mask = np.empty((height, width), dtype=np.uint8)
    depth = np.empty((height, width), dtype=np.float32)
    background = np.empty((height, width), dtype=np.float32)
    fill_background(eye, rotation, fov, plane, background)
    body = np.empty((len(objects), 17))
    body[:, KIND], body[:, HALF:CENTRE], body[:, RADIUS] = kinds, half_sizes, radius
    turned = matrix_from_quaternion(quaternions).reshape(len(positions), len(objects), 9)
    for k in range(len(positions)):
        rasterise_frame(kinds, half_sizes, positions[k], quaternions[k], eye, rotation, fov, background, mask, depth)
        body[:, CENTRE:AXES], body[:, AXES:RADIUS] = positions[k], turned[k]
        _shade_frame(body, *look, eye, rotation, focal_px(fov, height), antialias, mask, depth, draft, lit, out[k])
    return out
