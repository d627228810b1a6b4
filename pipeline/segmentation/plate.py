"""The background behind moving bodies: each pixel's median over the frames in which no body covers it."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.compiled import kernel

LEAST_CLEAR = 3  # frames in which a pixel must be clear
MARGIN_PX = 2  # around a body that does not count as clear: half-covered pixels, contact shadows


@kernel
def _clear_median(frames: np.ndarray, covered: np.ndarray, least: int, out: np.ndarray) -> None:
    count, height, width = covered.shape
    values = np.empty(count, np.uint8)
    for row in range(height):
        for col in range(width):
            clear = 0
            for t in range(count):
                clear += not covered[t, row, col]
            if clear == count or clear < least:
                continue
            for channel in range(3):
                k = 0
                for t in range(count):
                    if not covered[t, row, col]:
                        values[k] = frames[t, row, col, channel]
                        k += 1
                out[row, col, channel] = np.sort(values[:k])[k // 2]


def clear_plate(frames: np.ndarray, covered: np.ndarray, background: np.ndarray) -> np.ndarray:
    """The background (H, W, 3) uint8 without the bodies that are in it because they rest there or are slow.

    Args:
        frames: (T, H, W, 3) uint8.
        covered: (T, H, W) bool, where a body is seen.
        background: (H, W, 3) uint8, the median of all frames; it stays where a body always, or nearly, covers it.
    """
    size = 2 * MARGIN_PX + 1
    square = np.ones((size, size), np.uint8)
    grown = np.stack([cv2.dilate(c.astype(np.uint8), square) for c in covered]) > 0
    out = background.copy()
    _clear_median(frames, grown, LEAST_CLEAR, out)
    return out
