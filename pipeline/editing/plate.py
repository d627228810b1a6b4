"""The background plate: what the camera sees where no body and no shadow is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.compiled import kernel

MEASURED, REPAIRED, INVENTED = range(3)
LEAST_CLEAR = 3  # frames in which a pixel has to be clear to count as measured
MARGIN_PX = 2  # around a body, which is not clear: half-covered pixels, contact shadows
IN_SHADOW = 0.97  # least share of its light that a clear pixel has
REACH_PX = 4  # around a pixel that is invented
RING_PX = 8  # of measured pixels around others, which tell what those may look like
UNLIKE = 2.0  # standard deviations of the ring, beyond which a repaired pixel is not believed
LEAST_SPREAD = 1.0  # of 255, of a ring: what rounding and noise do
_CLIPPED = 0.831  # variance of a standard normal number whose size is clipped at its 90 % quantile


@dataclass(frozen=True)
class Plate:
    """The background.

    Attributes:
        colour: (H, W, 3) float32, 0 to 255.
        kind: (H, W) uint8: MEASURED, the median of the frames in which it is clear; REPAIRED, clear in few frames, or
            seen in shadow only, from which the shadow was taken; INVENTED, painted from around it: never seen, or seen
            in a shadow only that the lights do not explain.
        noise: Standard deviation of a pixel over time, 0 to 255.
    """

    colour: np.ndarray
    kind: np.ndarray
    noise: float


def grown(masks: np.ndarray, margin: int = MARGIN_PX) -> np.ndarray:
    """(T, H, W) bool: where masks (T, H, W) have a body, or have one within `margin` px."""
    square = np.ones((2 * margin + 1,) * 2, np.uint8)
    return np.stack([cv2.dilate((m > 0).astype(np.uint8), square) for m in masks]) > 0


def find_plate(frames: np.ndarray, covered: np.ndarray, ratio: np.ndarray) -> Plate:
    """The plate of a clip.

    Args:
        frames: (T, H, W, 3) uint8.
        covered: (T, H, W) bool, where bodies are in front of it.
        ratio: (T, H, W) float32, the light there as a share of that without the bodies' shadows.
    """
    height, width = covered.shape[1:]
    colour = np.zeros((height, width, 3), np.float32)
    clear, lit = np.zeros((height, width), np.int64), np.zeros((height, width), np.int64)
    _median(frames, covered, np.ascontiguousarray(ratio, np.float32), colour, clear, lit)
    kind = np.full((height, width), MEASURED, np.uint8)
    kind[(clear < LEAST_CLEAR) | (lit == 0)] = REPAIRED
    kind[clear == 0] = INVENTED
    kind[(kind == REPAIRED) & _unlike(colour.mean(-1), kind != MEASURED)] = INVENTED
    painted = (kind == INVENTED).astype(np.uint8)
    if painted.all():
        colour[:] = np.median(frames, axis=0)
    elif painted.any():
        seen = np.clip(colour + 0.5, 0, 255).astype(np.uint8)
        unlit = painted | (lit == 0).astype(np.uint8)  # a shadow around a body that rests is not painted onto its place
        around = cv2.inpaint(seen, painted if unlit.all() else unlit, REACH_PX, cv2.INPAINT_TELEA)
        colour[painted > 0] = around[painted > 0]
    return Plate(colour, kind, _noise(frames, covered))


def _unlike(brightness: np.ndarray, unsure: np.ndarray) -> np.ndarray:
    """(H, W) bool: which unsure pixels are much darker or brighter than the measured ones around their region.

    Where the ground has a texture, the measured pixels differ as much, and nothing is unlike them.

    Args:
        brightness: (H, W), 0 to 255.
        unsure: (H, W) bool.
    """
    out = np.zeros(unsure.shape, bool)
    count, labels = cv2.connectedComponents(unsure.astype(np.uint8))
    for k in range(1, count):
        region = labels == k
        ring = grown(region[None], RING_PX)[0] & ~unsure
        if ring.any():
            apart = np.abs(brightness - brightness[ring].mean())
            out |= region & (apart > UNLIKE * max(float(brightness[ring].std()), LEAST_SPREAD))
    return out


@kernel
def _median(
    frames: np.ndarray,
    covered: np.ndarray,
    ratio: np.ndarray,
    colour: np.ndarray,
    clear: np.ndarray,
    lit: np.ndarray,
) -> None:
    """Median over the clear frames with the light there above IN_SHADOW, else over all clear ones."""
    count, height, width = covered.shape
    values = np.empty((3, count), np.float32)
    for row in range(height):
        for col in range(width):
            seen, open_ = 0, 0
            for t in range(count):
                if not covered[t, row, col]:
                    seen += 1
                    open_ += ratio[t, row, col] >= IN_SHADOW
            clear[row, col], lit[row, col] = seen, open_
            if seen == 0:
                continue
            k = 0
            for t in range(count):
                if covered[t, row, col] or (open_ >= 1 and ratio[t, row, col] < IN_SHADOW):
                    continue
                for channel in range(3):
                    values[channel, k] = frames[t, row, col, channel] / ratio[t, row, col]
                k += 1
            for channel in range(3):
                ordered = np.sort(values[channel, :k])
                colour[row, col, channel] = 0.5 * (ordered[k // 2] + ordered[(k - 1) // 2])


def _noise(frames: np.ndarray, covered: np.ndarray) -> float:
    """Standard deviation of clear pixels from frame to frame, from their changes without the largest tenth."""
    step = (slice(None), slice(None, None, 3), slice(None, None, 3))
    values, clear = frames[step].astype(np.int16), ~covered[step]
    changes = np.abs(np.diff(values, axis=0))[clear[1:] & clear[:-1]].astype(float)
    if not changes.size:
        return 0.0
    clipped = np.minimum(changes, np.quantile(changes, 0.9))
    return float(np.sqrt(np.mean(clipped**2) / _CLIPPED / 2))
