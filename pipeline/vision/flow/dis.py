"""Optical flow by OpenCV's dense inverse search (Kroeger et al., ECCV 2016), with the interface of RAFT."""

from __future__ import annotations

import cv2
import numpy as np

PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


class DIS:
    """Dense inverse search on luminance, with one of OpenCV's `PRESETS`."""

    def __init__(self, preset: str = "medium") -> None:
        if preset not in PRESETS:
            raise ValueError(f"unknown DIS preset {preset!r}; valid: {', '.join(PRESETS)}")
        self.preset = preset

    def flow(
        self,
        frames_a: np.ndarray,
        frames_b: np.ndarray,
        iterations: int | None = None,
        size: tuple[int, int] | None = None,
    ) -> np.ndarray:
        """Flow from each frame of `frames_a` to that of `frames_b`.

        Args:
            frames_a: (B, H, W, 3) uint8 RGB.
            frames_b: (B, H, W, 3) uint8 RGB.
            iterations: Ignored; the preset fixes the iterations.
            size: Working size (width, height), px; None: that of the frames.

        Returns:
            (B, H, W, 2) float32, px of the given frames, x right and y down.
        """
        count, height, width = check_frames(frames_a, frames_b)
        search = cv2.DISOpticalFlow.create(PRESETS[self.preset])
        out = np.empty((count, height, width, 2), np.float32)
        for i in range(count):
            a, b = (cv2.cvtColor(f[i], cv2.COLOR_RGB2GRAY) for f in (frames_a, frames_b))
            if size is not None:
                a, b = (cv2.resize(x, size, interpolation=cv2.INTER_AREA) for x in (a, b))
            flow = search.calc(a, b, np.zeros((*a.shape, 2), np.float32))
            if size is not None:
                flow = cv2.resize(flow, (width, height)) * np.array([width / size[0], height / size[1]], np.float32)
            out[i] = flow
        return out


def check_frames(frames_a: np.ndarray, frames_b: np.ndarray) -> tuple[int, int, int]:
    """(B, H, W) of two arrays (B, H, W, 3) uint8. Raises ValueError where their shapes or types are wrong."""
    if frames_a.shape != frames_b.shape or frames_a.ndim != 4 or frames_a.shape[-1] != 3:
        raise ValueError(
            f"frames must be two arrays of one shape (B, H, W, 3), not {frames_a.shape} and {frames_b.shape}"
        )
    if frames_a.dtype != np.uint8 or frames_b.dtype != np.uint8:
        raise ValueError(f"frames must be uint8, not {frames_a.dtype} and {frames_b.dtype}")
    return frames_a.shape[0], frames_a.shape[1], frames_a.shape[2]
