"""The background behind moving bodies: each pixel's median over the frames in which no body covers it.

Where a body always is, as a slow one, the background is filled in from around it (Telea, J. Graphics Tools 2004).
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.compiled import kernel

LEAST_CLEAR = 3  # frames in which a pixel must be clear
ALIKE = 12  # of 255: change of a pixel's channels from which on it shows something else
REACH_PX = 4  # around a pixel that is filled in
MARGIN_PX = 2  # around a body that does not count as clear: half-covered pixels, contact shadows


@kernel
def _largest_change(one: np.ndarray, other: np.ndarray) -> float:
    largest = 0.0
    for k in range(3):
        largest = max(largest, abs(float(one[k]) - float(other[k])))
    return largest


@kernel
def _still_covered(frames: np.ndarray, covered: np.ndarray, out: np.ndarray) -> None:
    count, height, width = covered.shape
    for row in range(height):
        for col in range(width):
            for t in range(count):
                if not covered[t, row, col]:
                    continue
                out[t, row, col] = True
                for step in (-1, 1):
                    s = t + step
                    while 0 <= s < count and not covered[s, row, col]:
                        if _largest_change(frames[s, row, col], frames[t, row, col]) >= ALIKE:
                            break
                        out[s, row, col] = True
                        s += step


def still_covered(frames: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: where a body is seen, and where a pixel looks the same before or after a body is seen there.

    A body that comes to rest is lost little by little. frames: (T, H, W, 3) uint8, covered: (T, H, W) bool.
    """
    out = np.zeros(covered.shape, np.bool_)
    _still_covered(frames, covered, out)
    return out


@kernel
def _clear_median(frames: np.ndarray, covered: np.ndarray, out: np.ndarray) -> None:
    count, height, width = covered.shape
    values = np.empty(count, np.uint8)
    for row in range(height):
        for col in range(width):
            clear = 0
            for t in range(count):
                clear += not covered[t, row, col]
            if clear == count or clear < LEAST_CLEAR:
                continue
            for channel in range(3):
                k = 0
                for t in range(count):
                    if not covered[t, row, col]:
                        values[k] = frames[t, row, col, channel]
                        k += 1
                out[row, col, channel] = np.sort(values[:k])[k // 2]


def clear_plate(frames: np.ndarray, covered: np.ndarray, background: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The background without the bodies that are in it because they rest there or are slow.

    Args:
        frames: (T, H, W, 3) uint8.
        covered: (T, H, W) bool, where a body is seen.
        background: (H, W, 3) uint8, the median of all frames.

    Returns:
        The background (H, W, 3) uint8, and where it is filled in, since it is never, or hardly, seen: (H, W) bool.
    """
    square = np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)
    still = still_covered(frames, covered)
    grown = np.stack([cv2.dilate(c.astype(np.uint8), square) for c in still]) > 0
    out = background.copy()
    _clear_median(frames, grown, out)
    always = ((~still).sum(0) < LEAST_CLEAR).astype(np.uint8)
    filled = cv2.dilate(always, square) & ((~grown).sum(0) < LEAST_CLEAR)
    if filled.any():
        out = cv2.inpaint(out, filled, REACH_PX, cv2.INPAINT_TELEA)
    return out, filled > 0
