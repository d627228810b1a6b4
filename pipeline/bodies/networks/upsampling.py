"""Masks at the clip's own size: soft masks enlarged, with the frame as their guide.

The guided filter of He, Sun & Tang (TPAMI 2013) with a guide of three channels: in each window the mask is a linear
function of the colours, so its edge goes where the frame's is.
"""

from __future__ import annotations

import cv2
import numpy as np

REACH = 2.0  # working px: radius of the filter's windows
SMOOTHNESS = 1e-4  # of colours in [0, 1], squared


def guided_filter(guide: np.ndarray, source: np.ndarray, radius: int, smoothness: float) -> np.ndarray:
    """source (H, W) float32, filtered along the edges of guide (H, W, 3) float32 in [0, 1]. radius: of windows, px."""
    size = (2 * radius + 1, 2 * radius + 1)

    def mean(x: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.blur(x, size, borderType=cv2.BORDER_REFLECT))

    middle, level = mean(guide), mean(source)
    cross = mean(guide * source[..., None]) - middle * level[..., None]
    products = np.stack([guide[..., i] * guide[..., j] for i, j in _PAIRS], -1)
    spread = np.stack(
        [mean(np.ascontiguousarray(products[..., :3])), mean(np.ascontiguousarray(products[..., 3:]))], -2
    )
    spread = spread.reshape(*source.shape, 6) - np.stack([middle[..., i] * middle[..., j] for i, j in _PAIRS], -1)
    rr, rg, rb, gg, gb, bb = (spread[..., k] for k in range(6))
    rr, gg, bb = rr + smoothness, gg + smoothness, bb + smoothness
    # The inverse of the symmetric 3 x 3 covariance, by its cofactors.
    crr, crg, crb = gg * bb - gb * gb, gb * rb - rg * bb, rg * gb - gg * rb
    cgg, cgb, cbb = rr * bb - rb * rb, rb * rg - rr * gb, rr * gg - rg * rg
    scale = 1 / (rr * crr + rg * crg + rb * crb)
    r, g, b = (cross[..., k] for k in range(3))
    slope = np.stack([crr * r + crg * g + crb * b, crg * r + cgg * g + cgb * b, crb * r + cgb * g + cbb * b], -1)
    slope *= scale[..., None]
    constant = level - (slope * middle).sum(-1)
    return np.asarray((mean(np.ascontiguousarray(slope)) * guide).sum(-1) + mean(constant))


_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def enlarge(soft: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, tuple[slice, slice]]:
    """A soft mask (h, w) in [0, 1] at the size of frame (H, W, 3) uint8: values in a window, and the window.

    Outside the window the mask is 0.
    """
    height, width = frame.shape[:2]
    h, w = soft.shape
    scale = max(height / h, width / w)
    x, y, bw, bh = cv2.boundingRect((soft > 0.02).astype(np.uint8))
    if bw == 0:
        return np.zeros((0, 0), np.float32), (slice(0, 0), slice(0, 0))
    pad = 4
    left, right = max(x - pad, 0), min(x + bw + pad, w)
    top, bottom = max(y - pad, 0), min(y + bh + pad, h)
    window = (
        slice(round(top * height / h), round(bottom * height / h)),
        slice(round(left * width / w), round(right * width / w)),
    )
    size = (window[1].stop - window[1].start, window[0].stop - window[0].start)
    large = cv2.resize(np.ascontiguousarray(soft[top:bottom, left:right]), size, interpolation=cv2.INTER_LINEAR)
    guide = frame[window].astype(np.float32) / 255
    radius = max(round(REACH * scale), 1)
    return guided_filter(guide, large, radius, SMOOTHNESS), window
