"""Two neighbouring frames with the exact flow between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FramePair:
    """A training pair of optical flow.

    Attributes:
        frame_a: (H, W, 3) uint8, the first frame.
        frame_b: (H, W, 3) uint8, the second.
        flow_px: (H, W, 2) float32, the flow from the first to the second.
        foreground: (H, W) bool, the first frame's pixels of bodies that move or turn.
    """

    frame_a: np.ndarray
    frame_b: np.ndarray
    flow_px: np.ndarray
    foreground: np.ndarray

    def mirrored(self) -> FramePair:
        """Left and right exchanged."""
        flow = self.flow_px[:, ::-1] * np.array([-1, 1], np.float32)
        return FramePair(self.frame_a[:, ::-1], self.frame_b[:, ::-1], flow, self.foreground[:, ::-1])
