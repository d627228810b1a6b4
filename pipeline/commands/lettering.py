"""Words on pictures."""

from __future__ import annotations

import functools

import numpy as np
from PIL import Image, ImageDraw, ImageFont

INK, FAINT, PAPER = (25, 28, 33), (120, 125, 135), (255, 255, 255)
MARGIN = 8  # px


@functools.cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def caption(frames: np.ndarray, text: str, size: int = 15) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 with a caption in the upper left corner, white on a dark patch."""
    _, _, right, bottom = font(size).getbbox(text)
    width, height = round(right) + 2 * MARGIN, round(bottom) + MARGIN
    patch = Image.new("RGB", (width, height), INK)
    ImageDraw.Draw(patch).text((MARGIN, MARGIN // 2), text, font=font(size), fill=PAPER)
    out = frames.copy()
    height, width = min(height, frames.shape[1]), min(width, frames.shape[2])
    out[:, :height, :width] = np.asarray(patch)[:height, :width]
    return out


def side_by_side(left: np.ndarray, right: np.ndarray, captions: tuple[str, str], gap: int = 4) -> np.ndarray:
    """Two clips (T, H, W, 3) beside each other, with a caption each."""
    between = np.full((*left.shape[:2], gap, 3), 255, np.uint8)
    return np.concatenate([caption(left, captions[0]), between, caption(right, captions[1])], axis=2)
