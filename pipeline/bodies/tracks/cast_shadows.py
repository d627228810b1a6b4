"""Cast shadows on what has a texture: there a frame is the background times one factor, so its texture stays.

Change detection that ignores illumination (Jacques, Jung & Musse, SIBGRAPI 2005). On plain ground nothing can be told
this way: the network decides.
"""

from __future__ import annotations

import cv2
import numpy as np

DARKEST = 15.0  # of 255, added to values before their logarithm is taken
WINDOW = 5  # px
DARKER = 0.12, 1.6  # least and most mean drop of the logarithm in a shadow
LEAST_TEXTURE = 0.006  # variance of the background's logarithm in a window, from which on it has a texture
MOST_LEFT = 0.25  # of that variance, in the logarithm of the ratio of frame and background
MOST_TINT = 0.15  # mean difference of a channel's logarithm to that of all
SAME_SHADE = 0.25  # difference to the shade beside, up to which a pixel of a shadow's rim is in it too


def cast_shadows(frames: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: where frames (T, H, W, 3) uint8 show the textured background (H, W, 3) uint8 in a shadow."""
    behind = np.log(background.astype(np.float32) + DARKEST)
    texture = _variance(behind.mean(-1))
    textured = texture > LEAST_TEXTURE
    out = np.zeros(frames.shape[:3], bool)
    if not textured.any():
        return out
    square = np.ones((WINDOW, WINDOW), np.uint8)
    for found, frame in zip(out, frames, strict=True):
        ratio = np.log(frame.astype(np.float32) + DARKEST) - behind
        shade = ratio.mean(-1)
        tint = _mean(np.abs(ratio - shade[..., None]).max(-1))
        level = _mean(shade)
        sure = textured & (level < -DARKER[0]) & (level > -DARKER[1]) & (tint < MOST_TINT)
        sure &= _variance(shade) < MOST_LEFT * texture
        if not sure.any():
            continue
        share = _mean(sure.astype(np.float32))
        beside = _mean(np.where(sure, level, 0)) / np.maximum(share, 1e-6)
        near = cv2.dilate(sure.astype(np.uint8), square) > 0
        found[:] = near & (np.abs(shade - beside) < SAME_SHADE)
    return out


def _mean(picture: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.blur(picture, (WINDOW, WINDOW)))


def _variance(picture: np.ndarray) -> np.ndarray:
    return np.maximum(_mean(picture**2) - _mean(picture) ** 2, 0)
