"""The bodies of one frame, drawn with their textures over nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.editing.camera_rays import NOBODY, cast_bodies, paint
from pipeline.editing.light import Lights
from pipeline.editing.surface_texture import Textures
from pipeline.editing.view import View

SAMPLES = 2  # along each side of a pixel


@dataclass(frozen=True)
class Drawn:
    """The bodies of one frame.

    Attributes:
        colour: (H, W, 3) float32, times alpha.
        alpha: (H, W) float32.
        front: (H, W) uint8, the body that fills most of a pixel, or `NOBODY`.
        cover: (M, H, W) bool, where each body has a part of a pixel.
        kinds: (H, W) uint8, kind of the texel that most of a pixel shows.
    """

    colour: np.ndarray
    alpha: np.ndarray
    front: np.ndarray
    cover: np.ndarray
    kinds: np.ndarray


def draw(
    view: View,
    body: np.ndarray,
    corrections: np.ndarray,
    rectangles: np.ndarray,
    shown: np.ndarray,
    textures: Textures,
    lights: Lights,
) -> Drawn:
    """Draw M bodies.

    Args:
        view: The camera.
        body: (M, 17), as in `BodyMotion.tables`.
        corrections: (M, 5).
        rectangles: (M, 4) px, of `BodyMotion.rectangles`.
        shown: (M,) bool.
        textures: Of the M bodies.
        lights: The lights.
    """
    height, width, count = view.height, view.width, len(body)
    size = SAMPLES * height, SAMPLES * width
    ids, depth, point = np.empty(size, np.uint8), np.empty(size, np.float32), np.empty((*size, 3), np.float32)
    colour, kinds = np.zeros((*size, 3), np.float32), np.zeros(size, np.uint8)
    cast_bodies(body, corrections, rectangles, shown, *view.ray_arguments, ids, depth, point)
    paint(body, ids, point, textures.colour, textures.kind, lights.light, lights.on_bodies, colour, kinds)
    blocks = ids.reshape(height, SAMPLES, width, SAMPLES)
    counts = np.zeros((count, height, width), np.uint8)
    for m in range(count):
        counts[m] = _sum(ids == m)
    alpha = counts.sum(0).astype(np.float32) / SAMPLES**2
    mean = _sum(colour) / np.float32(SAMPLES**2)
    front = np.full((height, width), NOBODY, np.uint8)
    if count:
        front = np.where(alpha > 0.5, counts.argmax(0), NOBODY).astype(np.uint8)
    kind = np.zeros((height, width), np.uint8)  # that of the last sample which the front body fills
    own = kinds.reshape(height, SAMPLES, width, SAMPLES)
    for j in range(SAMPLES):
        for k in range(SAMPLES):
            hit = blocks[:, j, :, k] == front
            kind[hit] = own[:, j, :, k][hit]
    return Drawn(mean, alpha, front, counts > 0, kind)


def _sum(samples: np.ndarray) -> np.ndarray:
    """(H, W, ...) the sum over the samples (K H, K W, ...) of each pixel."""
    parts = [samples[j::SAMPLES, k::SAMPLES] for j in range(SAMPLES) for k in range(SAMPLES)]
    out = parts[0].astype(np.uint8) if samples.dtype == bool else parts[0].copy()
    for part in parts[1:]:
        out += part
    return out
