"""A small filmed clip with its scene, and its layers."""

from functools import cache

import numpy as np
import small_clip

from pipeline.editing.edited_motion import filmed_motion
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.layers import Layers, take_apart
from pipeline.editing.view import BodyMotion, view_of
from pipeline.physics.trace import Trace

FRAMES = 30
TIMES = np.arange(FRAMES) / 30


@cache
def clip() -> FilmedClip:
    return FilmedClip(small_clip.frames(), small_clip.masks(), TIMES)


@cache
def motion() -> tuple[BodyMotion, Trace]:
    return filmed_motion(small_clip.scene(), TIMES)


@cache
def layers() -> Layers:
    return take_apart(clip(), motion()[0], view_of(small_clip.scene(), small_clip.WIDTH, small_clip.HEIGHT))


def psnr(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float:
    """dB, over the pixels (T, H, W) of two clips (T, H, W, 3)."""
    return float(10 * np.log10(255**2 / max(np.mean((one[where].astype(float) - other[where]) ** 2), 1e-9)))
