"""How large objects are in the picture."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import kernel


def areas_px(masks: np.ndarray, objects: int) -> np.ndarray:
    """(F, N) area of each object in masks (F, H, W), px of 480x320."""
    counts = np.zeros((len(masks), objects + 1), np.int64)
    _count(masks.reshape(len(masks), -1), counts)
    return counts[:, 1:] * (480 * 320 / masks[0].size)


@kernel
def _count(masks: np.ndarray, counts: np.ndarray) -> None:
    """Into counts (F, N + 1): the pixels of masks (F, P) with each number up to N."""
    for frame in range(len(masks)):
        for pixel in range(masks.shape[1]):
            if masks[frame, pixel] < counts.shape[1]:
                counts[frame, masks[frame, pixel]] += 1
