"""The target of a search: instance masks and flow of the frames that the model sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.vision.rendering.camera import REFERENCE_SIZE

REFERENCE_AREA = math.prod(REFERENCE_SIZE)  # px²


@dataclass(frozen=True)
class Target:
    """Masks and flow to match.

    Attributes:
        masks: (F, H, W) uint8, j + 1 for instance j, 0 for the background.
        flow: (F, H, W, 2) float32, px of this size per frame interval.
        instances: Number of instances.
        flow_error: (M,) error of the flow of each instance, in errors of usual measured flow; None: all 1.
    """

    masks: np.ndarray
    flow: np.ndarray
    instances: int
    flow_error: np.ndarray | None = None

    @property
    def height(self) -> int:
        return self.masks.shape[1]

    @property
    def width(self) -> int:
        return self.masks.shape[2]


def make_target(
    masks: np.ndarray, flow: np.ndarray, width: int, height: int, flow_error: np.ndarray | None = None
) -> Target:
    """A target from masks and flow of any size.

    The camera does not move, so flow outside the instances is noise. It is set to zero.

    Args:
        masks: (F, H, W).
        flow: (F, h, w, 2), px of its own size.
        width: Width of the target, px.
        height: Height of the target, px.
        flow_error: (M,) as in `Target`; of bodies that these frames do not show, too.
    """
    small = resize_masks(masks, width, height)
    moving = resize_flow(flow, width, height) * (small > 0)[..., None]
    count = int(masks.max(initial=0))  # bodies with higher ids are in none of these frames
    return Target(
        small, np.ascontiguousarray(moving, np.float32), count, None if flow_error is None else flow_error[:count]
    )


def resize_masks(masks: np.ndarray, width: int, height: int) -> np.ndarray:
    """Masks (F, H, W) resized to width x height px."""
    return np.stack([cv2.resize(m, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) for m in masks])


def resize_flow(flow: np.ndarray, width: int, height: int) -> np.ndarray:
    """Flow (F, h, w, 2) px resized to width x height px, with its values in px of that size."""
    if flow.shape[1:3] == (height, width):
        return np.ascontiguousarray(flow, np.float32)
    mode = cv2.INTER_AREA if flow.shape[2] > width else cv2.INTER_LINEAR
    scale = np.array([width / flow.shape[2], height / flow.shape[1]], np.float32)
    return np.stack([cv2.resize(f.astype(np.float32), (width, height), interpolation=mode) for f in flow]) * scale
