"""A shaded ray caster: RGB pictures of analytic shapes on a floor, without OpenGL.

Lambert and Blinn-Phong shading, shadow rays, one mirror reflection, procedural textures fixed to the body, and four
rays for pixels with high contrast to a neighbour. Colours are added in display space, without gamma, as in MuJoCo's
renderer. Deterministic: the same arguments give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pipeline.compiled import inlined_kernel, kernel
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import FixedBody, SceneObject
from pipeline.scene.solid import bounding_radii
from pipeline.vision.rendering.appearance import Appearance
from pipeline.vision.rendering.camera import Pinhole, focal_px
from pipeline.vision.rendering.rasteriser import fill_background, rasterise_frame
from pipeline.vision.rendering.ray_queries import FLOOR, SKY, ambient_occlusion, nearest_hit, visible_share
from pipeline.vision.rendering.shading_tables import (
    AMBIENT,
    AXES,
    CENTRE,
    COLOUR,
    GROUND,
    HALF,
    HAZE,
    KIND,
    LIGHT,
    MIRROR,
    MOVING,
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
    shading_tables,
    sky,
    store,
)
from pipeline.vision.rendering.surface import fixed_arrays, normal, shape_arrays
from pipeline.vision.rendering.texture import texture

#: Contrast between neighbouring pixels above which a pixel gets four rays: of 255, and in visible lights.
_CONTRAST = 20
_LIT_CONTRAST = 0.3


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
    """Colour, normal and number of visible lights at the point p where a ray meets body i or the FLOOR.

    d: unit direction of the ray. t: its length, m. pixel: angle that a pixel spans, rad. shadows: whether lights can be
    hidden.
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
        around *= ambient_occlusion(body, int(world[MOVING]), i, px, py, pz, nx, ny, nz)
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
        share = visible_share(body, light, k, i, px, py, pz) if shadows else 1.0
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
    """The colour of the floor, blended with that of the horizon by distance."""
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
    """Colour along the ray o + t d with unit direction d, and the number of lights visible from its end.

    i: what the ray meets at distance t: a body, FLOOR or SKY.
    """
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
        mirror += (1.0 - mirror) * 0.5 * (1.0 + facing) ** 4  # a weaker form of Schlick's approximation
        j, s = nearest_hit(body, world[GROUND], i, px, py, pz, rx, ry, rz)
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
    """Whether a pixel differs from one of its four neighbours in object, in visible lights, or in colour.

    Colour counts on objects only: the texture of the floor is filtered already.
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
    wanted: np.ndarray,
    mask: np.ndarray,
    depth: np.ndarray,
    draft: np.ndarray,
    lit: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out uint8 (H, W, 3) with the picture of one frame.

    Args:
        body, material, light, world: Tables of `shading_tables`.
        eye: Position of the camera, (3,) m.
        camera: Rotation of the camera, (3, 3), columns right, up, back.
        focal: Focal length, px.
        antialias: Whether pixels with high contrast get four rays.
        wanted: bool (H, W), which pixels are drawn; the others become 0.
        mask, depth: (H, W) of this frame, from `rasterise_frame`.
        draft: uint8 (H, W, 3), work space.
        lit: float32 (H, W), work space: number of visible lights.
        out: Output.
    """
    height, width = mask.shape
    pixel = 1.0 / focal
    ox, oy, oz = eye[0], eye[1], eye[2]
    for row in range(height):
        y = (0.5 * height - row - 0.5) / focal
        for col in range(width):
            if not wanted[row, col]:
                draft[row, col] = 0
                lit[row, col] = 0.0
                continue
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
            if not wanted[row, col] or not _differs(draft, mask, lit, row, col):
                continue
            red, green, blue = 0.0, 0.0, 0.0
            for part in range(4):
                x = (col + (0.25 if part & 1 else 0.75) - 0.5 * width) / focal
                y = (0.5 * height - row - (0.25 if part & 2 else 0.75)) / focal
                length = math.sqrt(1.0 + x * x + y * y)
                dx = (camera[0, 0] * x + camera[0, 1] * y - camera[0, 2]) / length
                dy = (camera[1, 0] * x + camera[1, 1] * y - camera[1, 2]) / length
                dz = (camera[2, 0] * x + camera[2, 1] * y - camera[2, 2]) / length
                i, t = nearest_hit(body, world[GROUND], SKY, ox, oy, oz, dx, dy, dz)
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
    fixed: Sequence[FixedBody] = (),
    wanted: np.ndarray | None = None,
) -> np.ndarray:
    """Shaded pictures uint8 (F, H, W, 3) of F frames.

    Args:
        objects: N objects of analytic shapes.
        positions: (F, N, 3) m.
        quaternions: (F, N, 4) wxyz.
        camera: The camera.
        appearance: Materials of the objects, the fixed bodies and the floor, backdrop and lights.
        width: Width of the picture, px.
        height: Height of the picture, px.
        ground: Height of the floor, m; None for no floor.
        shadows: Whether lights cast shadows.
        antialias: Whether pixels with high contrast get four rays.
        fixed: Bodies that do not move.
        wanted: (F, H, W) bool, which pixels are drawn, the others become 0; None: all.

    Raises:
        SceneError: A body is a mesh.
    """
    assert len(appearance.materials) == len(objects), "an appearance has one material for each object"
    assert len(appearance.fixed) == len(fixed), "an appearance has one material for each fixed body"
    fixed_codes, fixed_halves, fixed_positions, fixed_quaternions = fixed_arrays(fixed)
    codes, halves = shape_arrays(objects)
    kinds, half_sizes = np.concatenate([codes, fixed_codes]), np.concatenate([halves, fixed_halves])
    bodies: list[SceneObject | FixedBody] = [*objects, *fixed]
    assert len(bodies) < 256, "a uint8 mask holds at most 255 bodies"
    radius = np.array(
        [np.inf if b.shape == "plane" else bounding_radii(b.shape, half_sizes[[i]])[0] for i, b in enumerate(bodies)]
    )
    positions, quaternions = (
        np.concatenate([moving, np.broadcast_to(still, (len(moving), *still.shape))], axis=1, dtype=np.float64)
        for moving, still in ((positions, fixed_positions), (quaternions, fixed_quaternions))
    )
    eye = np.ascontiguousarray(camera.position_world, dtype=np.float64)
    rotation = np.ascontiguousarray(camera.rotation_world, dtype=np.float64)
    fov = float(camera.fov_y_deg)
    plane = math.nan if ground is None else float(ground)
    tables = shading_tables(appearance, plane, shadows)
    out = np.empty((len(positions), height, width, 3), dtype=np.uint8)
    draft = np.empty((height, width, 3), dtype=np.uint8)
    lit = np.empty((height, width), dtype=np.float32)
    mask = np.empty((height, width), dtype=np.uint8)
    depth = np.empty((height, width), dtype=np.float32)
    background = np.empty((height, width), dtype=np.float32)
    fill_background(eye, rotation, fov, plane, background)
    body = np.empty((len(bodies), 17))
    body[:, KIND], body[:, HALF:CENTRE], body[:, RADIUS] = kinds, half_sizes, radius
    rotations = matrix_from_quaternion(quaternions).reshape(len(positions), len(bodies), 9)
    everywhere = np.ones((height, width), bool)
    for k in range(len(positions)):
        rasterise_frame(kinds, half_sizes, positions[k], quaternions[k], eye, rotation, fov, background, mask, depth)
        body[:, CENTRE:AXES], body[:, AXES:RADIUS] = positions[k], rotations[k]
        _shade_frame(
            body,
            *tables,
            eye,
            rotation,
            focal_px(fov, height),
            antialias,
            everywhere if wanted is None else wanted[k],
            mask,
            depth,
            draft,
            lit,
            out[k],
        )
    return out
