"""Which basic shape each body of a clip has, as the network for shapes sees it."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from pipeline.bodies.networks.outlines import pictures, square_of
from pipeline.bodies.networks.shape_network import ShapeNetwork
from pipeline.scene.scene import BASIC_SHAPES

MOST_FRAMES = 8  # of a body, that are looked at
LEAST_AREA_PX = 60  # of a mask; less does not tell a shape
LEAST_IN_VIEW = 0.35  # share of a body's outline's hull that nothing hides


def input_of(frame: Tensor, masks: Tensor) -> Tensor:
    """What the network is shown: (B, INPUTS, SIDE, SIDE).

    Args:
        frame: (B, 3, SIDE, SIDE) in [0, 1].
        masks: (B, 2, SIDE, SIDE) in [0, 1]: the body, other bodies.
    """
    middle = frame.mean((1, 2, 3), keepdim=True)
    spread = frame.std((1, 2, 3), keepdim=True)
    return torch.cat([(frame - middle) / (spread + 0.05), 2 * masks - 1], 1)


def tells_its_shape(mask: np.ndarray) -> bool:
    """Whether enough of a body is seen: mask (H, W) bool."""
    area = np.count_nonzero(mask)
    if area < LEAST_AREA_PX:
        return False
    hull = cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32))
    return bool(area >= LEAST_IN_VIEW * cv2.contourArea(hull))


def shape_probabilities(frames: np.ndarray, masks: np.ndarray, instances: int, network: ShapeNetwork) -> np.ndarray:
    """(N, 3) probabilities of `BASIC_SHAPES` for instances 1 to N; the same for all where too little is seen.

    Args:
        frames: (T, H, W, 3) uint8.
        masks: (T, H, W) uint8 ids.
        instances: N.
        network: For shapes. Its configuration says how many frames' answers are worth as much as independent ones.
    """
    out = np.full((instances, len(BASIC_SHAPES)), 1 / len(BASIC_SHAPES))
    boxes = [ndimage.find_objects(ids, instances) for ids in masks]
    for body in range(1, instances + 1):
        seen = [t for t, found in enumerate(boxes) if found[body - 1] and tells_its_shape(masks[t] == body)]
        if not seen:
            continue
        chosen = np.unique(np.linspace(0, len(seen) - 1, MOST_FRAMES).round().astype(int))
        shown, where = [], []
        for t in (seen[k] for k in chosen):
            rows, columns = boxes[t][body - 1]
            square = square_of(columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start)
            ids = square.part(masks[t])
            shown.append(square.cut(frames[t]))
            where.append([square.scaled(m) for m in (ids == body, (ids > 0) & (ids != body))])
        with torch.inference_mode():
            logits = network(input_of(pictures(shown), torch.from_numpy(np.array(where))))
        answer = logits.log_softmax(1).mean(0) * network.config["independent_frames"]
        out[body - 1] = answer.softmax(0).numpy()
    return out
