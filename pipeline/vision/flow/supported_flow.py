"""Flow that the pictures support: what an estimator guesses, on plain walls and under flicker, is filled in.

Each pixel gets a confidence. The background has the motion of the whole background as far as it was not measured (zero
for a camera at rest), and a body's pixels have the body's motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.vision.flow.body_motion import BodyMotion, body_motions
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.flow_confidence import consistency, settled_background, texture
from pipeline.vision.flow.measured_flow import recorded_pairs


@dataclass(frozen=True)
class SupportedFlow:
    """flow: (P, H, W, 2) float32, px of the frames per interval. confidence: (P, H, W) float32 in 0 to 1."""

    flow: np.ndarray
    confidence: np.ndarray


def supported_flow(
    flow: np.ndarray,
    frames: np.ndarray,
    masks: np.ndarray,
    recorded: np.ndarray,
    pairs: np.ndarray,
    *,
    interval: float,
    size: tuple[int, int],
) -> SupportedFlow:
    """The flow of `measured_flow` with what the pictures do not show filled in.

    Args:
        flow: (P, H, W, 2), px of the frames per interval.
        frames: (T, H, W, 3) uint8 RGB.
        masks: (T, H, W) uint8 ids of bodies, 0 for the background.
        recorded: (T,), when each frame was recorded, s.
        pairs: (P, 2) indices of frames.
        interval: Nominal interval, s.
        size: Working size (width, height), px.
    """
    first, second, scale = recorded_pairs(recorded, pairs, interval)
    back = DIS("medium").flow(frames[second], frames[first], size=size)
    out, sure = np.zeros_like(flow), np.ones(flow.shape[:-1], np.float32)
    for k in np.flatnonzero(scale):
        between = flow[k] / np.float32(scale[k])
        found, sure[k] = supported_pair(frames[first[k]], frames[second[k]], between, back[k], masks[first[k]], size)
        out[k] = np.float32(scale[k]) * found
    return SupportedFlow(out, sure)


def supported_pair(
    frame_a: np.ndarray,
    frame_b: np.ndarray,
    flow: np.ndarray,
    back: np.ndarray,
    mask: np.ndarray,
    size: tuple[int, int],
) -> tuple[np.ndarray, np.ndarray]:
    """The flow of one pair of frames with what the pictures do not show filled in, and the confidence in it.

    Args:
        frame_a: (H, W, 3) uint8 RGB.
        frame_b: (H, W, 3) uint8, the frame to which the flow leads.
        flow: (H, W, 2) px, the estimator's.
        back: (H, W, 2) px, an estimate from b to a.
        mask: (H, W) uint8 ids of bodies in frame a, 0 for the background.
        size: Working size (width, height), px.

    Returns:
        Flow (H, W, 2) px and confidence (H, W), float32.
    """
    height, width = mask.shape
    scale = np.array([width / size[0], height / size[1]], np.float32)
    small_a, small_b = (cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in (frame_a, frame_b))
    small_flow, small_back = (cv2.resize(f, size, interpolation=cv2.INTER_AREA) / scale for f in (flow, back))
    small_mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST_EXACT)
    background = small_mask == 0
    shown = texture(small_a, small_b, small_flow, background)
    returns = consistency(small_flow, small_back)
    motions = body_motions(small_a, small_b, small_flow, small_mask, returns)
    fill_bodies(small_flow, small_mask, motions, np.ones(2))
    sure = np.where(background, returns * shown, consistency(small_flow, small_back))
    sure = cv2.resize(sure.astype(np.float32), (width, height))
    out = settled_background(flow, sure, mask == 0)
    fill_bodies(out, mask, motions, scale)
    return out, sure


def fill_bodies(flow: np.ndarray, mask: np.ndarray, motions: dict[int, BodyMotion], scale: np.ndarray) -> None:
    """Give the pixels of bodies their motion, in place.

    Args:
        flow: (H, W, 2) px.
        mask: (H, W) uint8 ids.
        motions: Of the ids, in pixels that are `scale` times as large.
        scale: (2,) of x and y.
    """
    for body, motion in motions.items():
        rows, cols = np.nonzero(mask == body)
        flow[rows, cols] = motion.at((cols + 0.5) / scale[0] - 0.5, (rows + 0.5) / scale[1] - 0.5) * scale
