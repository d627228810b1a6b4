"""An appearance as numeric tables for the shading kernels, and the colours of the backdrop.

The kernels take a frame as four small tables, whose columns are named here: tuples of arrays and views of rows would
make them ten times slower, because of reference counting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pipeline.compiled import inlined_kernel, kernel
from pipeline.vision.rendering.appearance import Appearance, Backdrop, Material
from pipeline.vision.rendering.texture import TEXTURES, value_noise

RGB = tuple[float, float, float]

#: Columns of body (N + M, 17): objects, then fixed bodies. AXES: the rotation matrix, row by row. RADIUS: of the
#: bounding sphere.
KIND, HALF, CENTRE, AXES, RADIUS = 0, 1, 4, 7, 16
#: Columns of material (N + M + 1, 12): objects, fixed bodies, floor.
TEXTURE, SEED, SCALE, SPECULAR, SHININESS, MIRROR, COLOUR, SECOND = 0, 1, 2, 3, 4, 5, 6, 9
#: Columns of light (L, 8). TOWARDS: direction or position; NEAR: 1 for a position; DISC: radius of its disc.
TOWARDS, LIGHT, DISC, NEAR = 0, 3, 6, 7
#: Entries of world (13,). MOVING: number of objects, N.
GROUND, AMBIENT, HAZE, SHADOWS, CLOUDS, SKY_SEED, HORIZON, ZENITH, MOVING = 0, 1, 2, 3, 4, 5, 6, 9, 12


class ShadingTables(NamedTuple):
    """An `Appearance` as tables: material (N + M + 1, 12), the floor last; light (L, 8); world (13,)."""

    material: np.ndarray
    light: np.ndarray
    world: np.ndarray


def shading_tables(appearance: Appearance, ground: float, shadows: bool) -> ShadingTables:
    """The tables of an appearance. ground: height, m, or nan for none. shadows: whether lights cast shadows."""
    material = [
        (TEXTURES[m.texture], m.seed, m.scale, m.specular, m.shininess, m.mirror, *m.colour, *m.second_colour)
        for m in (*appearance.materials, *appearance.fixed, appearance.floor)
    ]
    light = [(*(x.towards or x.position or ()), *x.colour, x.radius, x.towards is None) for x in appearance.lights]
    back = appearance.backdrop
    sky_values = (back.clouds, back.seed, *back.horizon, *back.zenith)
    world = (ground, appearance.ambient, appearance.haze, shadows, *sky_values, len(appearance.materials))
    return ShadingTables(
        np.array(material, dtype=np.float64),
        np.array(light, dtype=np.float64).reshape(-1, 8),
        np.array(world, dtype=np.float64),
    )


@inlined_kernel
def sky(world: np.ndarray, dx: float, dy: float, dz: float) -> RGB:
    """Colour of the backdrop in the unit direction d."""
    height = math.sqrt(max(dz, 0.0)) if dz > 0 else 0.3 * math.sqrt(-dz)
    if world[CLOUDS] > 0.0:
        seed = int(world[SKY_SEED])
        cloud = value_noise(5.0 * dx, 5.0 * dy, 12.0 * dz, seed)
        cloud += 0.5 * value_noise(11.0 * dx, 11.0 * dy, 26.0 * dz, seed + 1) - 0.75
        height += world[CLOUDS] * cloud
    height = min(max(height, 0.0), 1.0)
    return (
        world[HORIZON] + height * (world[ZENITH] - world[HORIZON]),
        world[HORIZON + 1] + height * (world[ZENITH + 1] - world[HORIZON + 1]),
        world[HORIZON + 2] + height * (world[ZENITH + 2] - world[HORIZON + 2]),
    )


@inlined_kernel
def store(out: np.ndarray, row: int, col: int, red: float, green: float, blue: float) -> None:
    """Write a colour in [0, 1] into out uint8 (H, W, 3), clipped and rounded."""
    out[row, col, 0] = np.uint8(min(max(red, 0.0), 1.0) * 255.0 + 0.5)
    out[row, col, 1] = np.uint8(min(max(green, 0.0), 1.0) * 255.0 + 0.5)
    out[row, col, 2] = np.uint8(min(max(blue, 0.0), 1.0) * 255.0 + 0.5)


@kernel
def _fill_sky(world: np.ndarray, directions: np.ndarray, out: np.ndarray) -> None:
    for m in range(directions.shape[0]):
        red, green, blue = sky(world, directions[m, 0], directions[m, 1], directions[m, 2])
        store(out, m, 0, red, green, blue)


def sky_colour(backdrop: Backdrop, directions: np.ndarray) -> np.ndarray:
    """Colours uint8 (M, 3) of the backdrop in unit directions (M, 3), world frame."""
    world = shading_tables(Appearance((), Material((0, 0, 0)), backdrop, ()), math.nan, shadows=False).world
    out = np.empty((len(directions), 1, 3), dtype=np.uint8)
    _fill_sky(world, np.ascontiguousarray(directions, dtype=np.float64), out)
    return out[:, 0]
