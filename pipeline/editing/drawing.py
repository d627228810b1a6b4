"""The bodies of one frame, drawn with their textures over nothing; and how sharp a clip shows its bodies' edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.editing.camera_rays import NOBODY, cast_bodies, paint
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.light import Lights, ground_light
from pipeline.editing.plate import grown
from pipeline.editing.surface_texture import Textures
from pipeline.editing.view import BodyMotion, View

SAMPLES = 2  # along each side of a pixel
BLURS = (0.0, 0.35, 0.5, 0.7, 0.9, 1.2, 1.6)  # px, standard deviations that are tried
FRAMES = 4  # that they are tried in
RIM_PX = 2  # about the bodies' edges, where they are compared


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


def blurred(drawn: Drawn, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3) and alpha (H, W) with edges blurred by `sigma` px.

    Textures come from the clip, so they have its blur already: only the edges get it.
    """
    alpha, colour = drawn.alpha, drawn.colour / np.maximum(drawn.alpha, 1e-6)[..., None]
    if sigma == 0:
        return colour, alpha
    soft = cv2.GaussianBlur(alpha, (0, 0), sigma)
    spread = cv2.GaussianBlur(drawn.colour, (0, 0), sigma) / np.maximum(soft, 1e-6)[..., None]
    return np.where(alpha[..., None] > 0, colour, spread), soft


def find_blur(
    clip: FilmedClip,
    view: View,
    motion: BodyMotion,
    corrections: np.ndarray,
    plate: np.ndarray,
    textures: Textures,
    lights: Lights,
) -> float:
    """The blur of edges, px, with which a clip that is drawn anew is nearest to what was filmed.

    Args:
        clip: T frames.
        view: The camera.
        motion: Its N bodies.
        corrections: (T, N, 5).
        plate: (H, W, 3) float32.
        textures: Of the bodies.
        lights: The lights.
    """
    rectangles, errors = motion.rectangles(view), np.zeros(len(BLURS))
    for t in np.unique(np.linspace(0, len(clip.frames) - 1, FRAMES).astype(int)):
        pose = motion.tables[t], corrections[t], rectangles[t], motion.shown[t]
        drawn = draw(view, *pose, textures, lights)
        behind = plate * ground_light(motion, view, corrections, t, lights).astype(np.float32)[..., None]
        body = (drawn.alpha > 0.5)[None]
        rim = (grown(body, RIM_PX) & grown(~body, RIM_PX))[0]
        for k, sigma in enumerate(BLURS):
            colour, alpha = blurred(drawn, sigma)
            made = behind + alpha[..., None] * (colour - behind)
            errors[k] += float(((made - clip.frames[t])[rim] ** 2).sum())
    return BLURS[int(errors.argmin())]
