"""Labels of the shadows that bodies cast, from a picture of the scene without them."""

from __future__ import annotations

import numpy as np

from training.segmentation.clip import BODY_SHADOW

LEAST_DARKENING = 0.1  # of the light: from here on a shadow is labelled
OUT_OF_VIEW_M = -100.0  # below the ground, which hides what is there


def with_empty_scene(position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, N, 3) and (T, N, 4) with one more moment, in which no body is in view."""
    away = position[:1].copy()
    away[..., 2] = OUT_OF_VIEW_M
    return np.concatenate([position, away]), np.concatenate([quaternion, quaternion[:1]])


def label_shadows(frames: np.ndarray, empty: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(T, H, W) uint8, BODY_SHADOW where a frame (T, H, W, 3) is darker than the empty scene (H, W, 3), else 0.

    mask: (T, H, W) ids of the bodies, where there is no label.
    """
    light = frames.mean(-1) + 4
    dark = light < (1 - LEAST_DARKENING) * (empty.mean(-1) + 4)
    return np.where(dark & (mask == 0), BODY_SHADOW, 0).astype(np.uint8)
