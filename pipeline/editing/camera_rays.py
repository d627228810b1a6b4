"""Ray casting of bodies whose pictures are moved and scaled a little, to where the clip shows them.

A correction (5,) of a body in a frame is its projected centre u, v, px, then the shift du, dv, px, and the factor s:
what the model shows at x the clip shows at centre + shift + s (x - centre). `body` is the table (N, 17) of
`pipeline.vision.rendering.shading_tables`.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import inlined_kernel, kernel
from pipeline.vision.rendering.ray_queries import intersect_body, visible_share
from pipeline.vision.rendering.shading_tables import AXES, CENTRE, HALF, KIND, TOWARDS
from pipeline.vision.rendering.surface import normal

NOBODY = 255
_LEAST_HEIGHT = 0.3  # of a light's direction above the ground, in the ratio of a surface's light to the ground's
_LEAST_LIGHT = 0.25  # of the ground's, by which a colour is divided


@inlined_kernel
def _inverse_depth_at(inverse_depth: np.ndarray, u: float, v: float) -> float:
    """1 / planar depth at a point of the picture, px; linear between pixels, which is exact on a plane."""
    height, width = inverse_depth.shape
    x = min(max(u - 0.5, 0.0), width - 1.0)
    y = min(max(v - 0.5, 0.0), height - 1.0)
    col, row = min(int(x), width - 2), min(int(y), height - 2)
    x, y = x - col, y - row
    above = (1 - x) * inverse_depth[row, col] + x * inverse_depth[row, col + 1]
    below = (1 - x) * inverse_depth[row + 1, col] + x * inverse_depth[row + 1, col + 1]
    return (1 - y) * above + y * below


@kernel
def cast_bodies(
    body: np.ndarray,
    correction: np.ndarray,
    rectangle: np.ndarray,
    shown: np.ndarray,
    eye: np.ndarray,
    rotation: np.ndarray,
    focal: float,
    inverse_depth: np.ndarray,
    ids: np.ndarray,
    depth: np.ndarray,
    point: np.ndarray,
) -> None:
    """What each sample of a picture shows first of the bodies.

    Args:
        body: (N, 17).
        correction: (N, 5).
        rectangle: (N, 4) px of the model's picture, which hold each body: u0, u1, v0, v1.
        shown: (N,) bool, which bodies there are.
        eye: (3,) m, the camera.
        rotation: (3, 3), columns right, up, back.
        focal: px.
        inverse_depth: (H, W) 1/m of what does not move; 0 where there is nothing.
        ids: (K H, K W) uint8, output: the body, or `NOBODY`; K samples along each side of a pixel.
        depth: (K H, K W) float32, output, m.
        point: (K H, K W, 3) float32, output: on the body's surface, m, body frame.
    """
    height, width = inverse_depth.shape
    per = ids.shape[0] // height
    ids[:] = NOBODY
    depth[:] = np.inf
    for i in range(body.shape[0]):
        if not shown[i]:
            continue
        cu, cv, du, dv, s = correction[i]
        first_col = max(math.floor((cu + du + s * (rectangle[i, 0] - cu)) * per) - 1, 0)
        last_col = min(math.ceil((cu + du + s * (rectangle[i, 1] - cu)) * per) + 1, per * width)
        first_row = max(math.floor((cv + dv + s * (rectangle[i, 2] - cv)) * per) - 1, 0)
        last_row = min(math.ceil((cv + dv + s * (rectangle[i, 3] - cv)) * per) + 1, per * height)
        x, y, z = eye[0] - body[i, CENTRE], eye[1] - body[i, CENTRE + 1], eye[2] - body[i, CENTRE + 2]
        ox = body[i, AXES] * x + body[i, AXES + 3] * y + body[i, AXES + 6] * z
        oy = body[i, AXES + 1] * x + body[i, AXES + 4] * y + body[i, AXES + 7] * z
        oz = body[i, AXES + 2] * x + body[i, AXES + 5] * y + body[i, AXES + 8] * z
        for row in range(first_row, last_row):
            v = cv + ((row + 0.5) / per - cv - dv) / s
            b = (0.5 * height - v) / focal
            for col in range(first_col, last_col):
                u = cu + ((col + 0.5) / per - cu - du) / s
                a = (u - 0.5 * width) / focal
                dx = rotation[0, 0] * a + rotation[0, 1] * b - rotation[0, 2]
                dy = rotation[1, 0] * a + rotation[1, 1] * b - rotation[1, 2]
                dz = rotation[2, 0] * a + rotation[2, 1] * b - rotation[2, 2]
                t = intersect_body(body, i, eye[0], eye[1], eye[2], dx, dy, dz)
                if t < depth[row, col] and t * _inverse_depth_at(inverse_depth, u, v) < 1.0 + 1e-3:
                    depth[row, col] = t
                    ids[row, col] = i
                    point[row, col, 0] = ox + t * (body[i, AXES] * dx + body[i, AXES + 3] * dy + body[i, AXES + 6] * dz)
                    point[row, col, 1] = oy + t * (
                        body[i, AXES + 1] * dx + body[i, AXES + 4] * dy + body[i, AXES + 7] * dz
                    )
                    point[row, col, 2] = oz + t * (
                        body[i, AXES + 2] * dx + body[i, AXES + 5] * dy + body[i, AXES + 8] * dz
                    )


@kernel
def cast_shadow(
    body: np.ndarray,
    correction: np.ndarray,
    eye: np.ndarray,
    rotation: np.ndarray,
    focal: float,
    inverse_depth: np.ndarray,
    light: np.ndarray,
    step: int,
    visible: np.ndarray,
) -> None:
    """Multiply the share of each light that one body leaves visible into visible (L, H / step, W / step).

    The other arguments are those of `cast_bodies` for one body: body (1, 17), correction (5,). light: (L, 8).
    """
    height, width = inverse_depth.shape
    cu, cv, du, dv, s = correction
    for row in range(visible.shape[1]):
        v = cv + ((row + 0.5) * step - cv - dv) / s
        b = (0.5 * height - v) / focal
        for col in range(visible.shape[2]):
            u = cu + ((col + 0.5) * step - cu - du) / s
            near = _inverse_depth_at(inverse_depth, u, v)
            if near <= 0.0:
                continue
            a = (u - 0.5 * width) / focal
            x = eye[0] + (rotation[0, 0] * a + rotation[0, 1] * b - rotation[0, 2]) / near
            y = eye[1] + (rotation[1, 0] * a + rotation[1, 1] * b - rotation[1, 2]) / near
            z = eye[2] + (rotation[2, 0] * a + rotation[2, 1] * b - rotation[2, 2]) / near
            for k in range(light.shape[0]):
                visible[k, row, col] *= visible_share(body, light, k, -1, x, y, z)


@inlined_kernel
def _light_of(
    body: np.ndarray,
    light: np.ndarray,
    darkness: np.ndarray,
    skip: int,
    p: tuple[float, float, float],
    n: tuple[float, float, float],
) -> float:
    """The light on point p with normal n (world frame), as a multiple of that on open ground."""
    total = 1.0
    for k in range(light.shape[0]):
        total -= darkness[k]
        lx, ly, lz = light[k, TOWARDS], light[k, TOWARDS + 1], light[k, TOWARDS + 2]
        along = n[0] * lx + n[1] * ly + n[2] * lz
        if along > 0.0:
            seen = visible_share(body, light, k, skip, p[0], p[1], p[2])
            total += darkness[k] * seen * along / max(lz, _LEAST_HEIGHT)
    return total


@inlined_kernel
def _world_surface(
    body: np.ndarray, i: int, x: float, y: float, z: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Point and normal in the world frame of the surface point x, y, z of body i."""
    nx, ny, nz = normal(int(body[i, KIND]), body[i, HALF], body[i, HALF + 1], body[i, HALF + 2], x, y, z)
    p = (
        body[i, CENTRE] + body[i, AXES] * x + body[i, AXES + 1] * y + body[i, AXES + 2] * z,
        body[i, CENTRE + 1] + body[i, AXES + 3] * x + body[i, AXES + 4] * y + body[i, AXES + 5] * z,
        body[i, CENTRE + 2] + body[i, AXES + 6] * x + body[i, AXES + 7] * y + body[i, AXES + 8] * z,
    )
    n = (
        body[i, AXES] * nx + body[i, AXES + 1] * ny + body[i, AXES + 2] * nz,
        body[i, AXES + 3] * nx + body[i, AXES + 4] * ny + body[i, AXES + 5] * nz,
        body[i, AXES + 6] * nx + body[i, AXES + 7] * ny + body[i, AXES + 8] * nz,
    )
    return p, n


@inlined_kernel
def _texel(body: np.ndarray, i: int, x: float, y: float, z: float, size: int) -> tuple[int, float, float]:
    """Face, row and column (from the centre of the first texel) of a surface point in a cube map of the body."""
    x, y, z = x / body[i, HALF], y / body[i, HALF + 1], z / body[i, HALF + 2]
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, a, b, c = (0 if x >= 0 else 1), y, z, ax
    elif ay >= az:
        face, a, b, c = (2 if y >= 0 else 3), x, z, ay
    else:
        face, a, b, c = (4 if z >= 0 else 5), x, y, az
    row = min(max((b / c + 1) * 0.5 * size - 0.5, 0.0), size - 1.0)
    col = min(max((a / c + 1) * 0.5 * size - 0.5, 0.0), size - 1.0)
    return face, row, col


@kernel
def paint(
    body: np.ndarray,
    ids: np.ndarray,
    point: np.ndarray,
    texture: np.ndarray,
    kind: np.ndarray,
    light: np.ndarray,
    darkness: np.ndarray,
    colour: np.ndarray,
    kinds: np.ndarray,
) -> None:
    """Colours of the samples that show a body.

    Args:
        body: (N, 17).
        ids: (K H, K W) uint8, of `cast_bodies`.
        point: (K H, K W, 3), of `cast_bodies`.
        texture: (N, 6, S, S, 3) float32, colours in the light of open ground.
        kind: (N, 6, S, S) uint8.
        light: (L, 8).
        darkness: (L,) share of the light on open ground that is each light's.
        colour: (K H, K W, 3) float32, output.
        kinds: (K H, K W) uint8, output: kind of the texel that is shown.
    """
    size = texture.shape[2]
    for row in range(ids.shape[0]):
        for col in range(ids.shape[1]):
            i = int(ids[row, col])
            if i == NOBODY:
                continue
            x, y, z = float(point[row, col, 0]), float(point[row, col, 1]), float(point[row, col, 2])
            face, b, a = _texel(body, i, x, y, z, size)
            r, c = int(b), int(a)
            b, a = b - r, a - c
            r1, c1 = min(r + 1, size - 1), min(c + 1, size - 1)
            p, n = _world_surface(body, i, x, y, z)
            bright = _light_of(body, light, darkness, i, p, n)
            for channel in range(3):
                above = (1 - a) * texture[i, face, r, c, channel] + a * texture[i, face, r, c1, channel]
                below = (1 - a) * texture[i, face, r1, c, channel] + a * texture[i, face, r1, c1, channel]
                colour[row, col, channel] = bright * ((1 - b) * above + b * below)
            kinds[row, col] = kind[i, face, int(b + r + 0.5), int(a + c + 0.5)]


@kernel
def gather(
    body: np.ndarray,
    i: int,
    point: np.ndarray,
    correction: np.ndarray,
    eye: np.ndarray,
    rotation: np.ndarray,
    focal: float,
    frame: np.ndarray,
    clear: np.ndarray,
    light: np.ndarray,
    darkness: np.ndarray,
    colour: np.ndarray,
    weight: np.ndarray,
) -> None:
    """Write what one frame shows of the texels of body i, each weighted by the fourth power of the facing cosine.

    Args:
        body: (N, 17).
        i: Which body.
        point: (M, 3) m, the texels on its surface, body frame.
        correction: (5,) of the body in this frame.
        eye: (3,) m, the camera.
        rotation: (3, 3), columns right, up, back.
        focal: px.
        frame: (H, W, 3) uint8.
        clear: (H, W) bool, where this body is seen for certain.
        light: (L, 8).
        darkness: (L,).
        colour: (M, 3) float32, output: in the light of open ground; untouched where a texel is not seen.
        weight: (M,) float32, output; untouched there.
    """
    height, width = clear.shape
    cu, cv, du, dv, s = correction
    for m in range(point.shape[0]):
        p, n = _world_surface(body, i, point[m, 0], point[m, 1], point[m, 2])
        x, y, z = eye[0] - p[0], eye[1] - p[1], eye[2] - p[2]
        facing = (n[0] * x + n[1] * y + n[2] * z) / math.sqrt(x * x + y * y + z * z)
        deep = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
        if facing < 0.1 or deep <= 0.0:
            continue
        u = 0.5 * width - focal * (rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z) / deep
        v = 0.5 * height + focal * (rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z) / deep
        u, v = cu + du + s * (u - cu) - 0.5, cv + dv + s * (v - cv) - 0.5
        col, row = math.floor(u), math.floor(v)
        if col < 0 or row < 0 or col >= width - 1 or row >= height - 1:
            continue
        if not (clear[row, col] and clear[row, col + 1] and clear[row + 1, col] and clear[row + 1, col + 1]):
            continue
        a, b = u - col, v - row
        bright = max(_light_of(body, light, darkness, i, p, n), _LEAST_LIGHT)
        for channel in range(3):
            above = (1 - a) * frame[row, col, channel] + a * frame[row, col + 1, channel]
            below = (1 - a) * frame[row + 1, col, channel] + a * frame[row + 1, col + 1, channel]
            colour[m, channel] = ((1 - b) * above + b * below) / bright
        weight[m] = facing**4
