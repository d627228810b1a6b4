"""Procedural solid textures: the share of a material's second colour at a point.

They are functions of the point in the body frame, so they rotate with the body and make its rotation visible. A seed
selects one of many variants.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import kernel

PLAIN, STRIPES, CHECKER, NOISE, SPOTS = range(5)
#: Code of each texture.
TEXTURES: dict[str, int] = {"plain": PLAIN, "stripes": STRIPES, "checker": CHECKER, "noise": NOISE, "spots": SPOTS}


@kernel
def lattice(i: int, j: int, k: int, seed: int) -> float:
    """A hash of a point of the integer lattice, in [0, 1)."""
    h = np.uint32(i * 374761393 + j * 668265263 + k * 1274126177 + seed * 1440670441)
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(1274126177))
    h = np.uint32((h ^ (h >> np.uint32(16))) * np.uint32(2246822519))
    h = np.uint32(h ^ (h >> np.uint32(15)))
    return h * (1.0 / 4294967296.0)


@kernel
def value_noise(x: float, y: float, z: float, seed: int) -> float:
    """Value noise in [0, 1] with features of size 1: lattice values, interpolated by 3 t² - 2 t³."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    i, j, k = int(fx), int(fy), int(fz)
    u, v, w = x - fx, y - fy, z - fz
    u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
    total = 0.0
    for corner in range(8):
        a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
        weight = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
        total += weight * lattice(i + a, j + b, k + c, seed)
    return total


@kernel
def _soft_step(value: float, softness: float) -> float:
    return min(max(0.5 + value / softness, 0.0), 1.0)


@kernel
def texture(kind: int, scale: float, seed: int, px: float, py: float, pz: float, footprint: float) -> float:
    """Share of the second colour, in [0, 1], at a point.

    Edges are blurred over the footprint and patterns finer than it fade to their mean, which suppresses aliasing.

    Args:
        kind: Code of `TEXTURES`.
        scale: Size of the features, m.
        seed: Variant.
        px, py, pz: The point in the body frame, m.
        footprint: Length that a pixel covers at the point, m.
    """
    if kind == PLAIN:
        return 0.0
    x, y, z = px / scale, py / scale, pz / scale
    softness = max(footprint / scale, 0.02)
    # Offset from the lattice, so that a flat face does not coincide with the border between two cells.
    ox, oy, oz = lattice(1, 0, 0, seed), lattice(0, 1, 0, seed), lattice(0, 0, 1, seed)
    mix = 0.5
    if kind == STRIPES:
        # Oblique to the body axes, so that no rotation about an axis leaves the stripes unchanged.
        angle = 6.283185307179586 * ox
        along = 0.8 * (x * math.cos(angle) + y * math.sin(angle)) + 0.6 * z + oz
        mix = _soft_step(abs(along - 2.0 * math.floor(along * 0.5) - 1.0) - 0.5, softness)
    elif kind == CHECKER:
        product = 1.0
        x, y, z = x + 0.13 + 0.2 * ox, y + 0.13 + 0.2 * oy, z + 0.13 + 0.2 * oz
        for axis in range(3):
            value = x if axis == 0 else (y if axis == 1 else z)
            cell = math.floor(value)
            edge = 0.5 - abs(value - cell - 0.5)  # distance to the nearest border
            sign = 1.0 if int(cell) & 1 else -1.0
            product *= sign * min(2.0 * edge / softness, 1.0)
        mix = 0.5 + 0.5 * product
    elif kind == NOISE:
        mix = value_noise(x + 8.0 * ox, y + 8.0 * oy, z + 8.0 * oz, seed)
        if softness < 0.8:
            mix += 0.5 * (value_noise(2.1 * x + 5.3, 2.1 * y, 2.1 * z, seed + 1) - 0.5)
        mix = min(max(2.2 * (mix - 0.5) + 0.5, 0.0), 1.0)
    elif kind == SPOTS:
        x, y, z = x + ox, y + oy, z + oz
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        radius = 0.3 + 0.18 * lattice(i, j, k, seed)
        room = 1.0 - 2.0 * radius
        cx = i + radius + room * lattice(i, j, k, seed + 1)
        cy = j + radius + room * lattice(i, j, k, seed + 2)
        cz = k + radius + room * lattice(i, j, k, seed + 3)
        mix = _soft_step(radius - math.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2), softness)
    fade = min(max(0.7 * footprint / scale - 0.2, 0.0), 1.0)
    return mix + (0.5 - mix) * fade
