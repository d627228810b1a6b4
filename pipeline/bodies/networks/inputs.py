"""What the network is given: a frame, and what the clip's other frames say of its pixels."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

NEAR, FAR = 2, 6  # frames before and after that a frame is compared with
FULL_CHANNELS, HALF_CHANNELS = 16, 4
DARKEST = 0.06  # added to values in [0, 1] before a ratio is taken: noise in the dark says little
FLOW_PRESET = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM


@dataclass(frozen=True)
class ClipFeatures:
    """Of a clip (T, H, W, 3) uint8: background, low and high, (H, W, 3) uint8, each pixel's median, second lowest and
    second highest value; flicker, (H, W) uint8, its median change from frame to frame; forward and backward,
    (T - 1, H / 2, W / 2, 2) float16, flow from frame t to t + 1 and back, px of H x W."""

    background: np.ndarray
    low: np.ndarray
    high: np.ndarray
    flicker: np.ndarray
    forward: np.ndarray
    backward: np.ndarray


def steady_exposure(frames: np.ndarray) -> np.ndarray:
    """The frames (T, H, W, 3) uint8 with each channel's gain made that of the clip's median picture.

    The gain is the median ratio over the pixels, so bodies that cover less than half of the picture do not change it.
    """
    background = np.median(frames[:, ::2, ::2], axis=0).astype(np.float32) + 4
    out = np.empty_like(frames)
    steps = np.arange(256, dtype=np.float32)
    for t, frame in enumerate(frames):
        ratio = (frame[::2, ::2].astype(np.float32) + 4) / background
        gain = np.clip(np.median(ratio.reshape(-1, 3), axis=0), 0.5, 2.0)
        if np.abs(gain - 1).max() < 0.004:
            out[t] = frame
            continue
        table = np.clip((steps[:, None] + 4) / gain - 4 + 0.5, 0, 255).astype(np.uint8)
        out[t] = cv2.LUT(np.ascontiguousarray(frame), table.reshape(256, 1, 3))
    return out


def clip_features(frames: np.ndarray) -> ClipFeatures:
    """The features of a clip (T, H, W, 3) uint8, T of 2 or more, of even height and width."""
    count, height, width = frames.shape[:3]
    assert count >= 2 and height % 2 == 0 and width % 2 == 0
    order = np.sort(frames, axis=0)
    edge = min(1, (count - 1) // 2)
    steps = np.stack([cv2.absdiff(a, b).max(-1) for a, b in itertools.pairwise(frames)])
    search = cv2.DISOpticalFlow.create(FLOW_PRESET)
    grey = [cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in frames]
    size = (width // 2, height // 2)

    def flow(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        found = search.calc(a, b, np.zeros((height, width, 2), np.float32))
        return cv2.resize(found, size, interpolation=cv2.INTER_AREA).astype(np.float16)

    return ClipFeatures(
        background=order[count // 2],
        low=order[edge],
        high=order[-1 - edge],
        flicker=np.sort(steps, axis=0)[len(steps) // 2],
        forward=np.stack([flow(a, b) for a, b in itertools.pairwise(grey)]),
        backward=np.stack([flow(b, a) for a, b in itertools.pairwise(grey)]),
    )


def flows_at(features: ClipFeatures, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Flow (H / 2, W / 2, 2) float32 from frame t to the next and to the last; at an end the other's opposite."""
    count = len(features.forward) + 1
    forward = features.forward[t] if t < count - 1 else -features.backward[t - 1]
    backward = features.backward[t - 1] if t else -features.forward[0]
    return forward.astype(np.float32), backward.astype(np.float32)


def neighbours(t: int, count: int, near: int = NEAR, far: int = FAR) -> tuple[int, int, int, int]:
    """The frames that frame t of `count` is compared with: near before and after, far before and after."""
    return max(t - near, 0), min(t + near, count - 1), max(t - far, 0), min(t + far, count - 1)


def network_input(
    frame: Tensor, background: Tensor, low: Tensor, high: Tensor, flicker: Tensor, others: Tensor, flow: Tensor
) -> tuple[Tensor, Tensor]:
    """The network's two inputs, (B, FULL_CHANNELS, H, W) and (B, HALF_CHANNELS, H / 2, W / 2).

    frame, background, low, high: (B, 3, H, W) in [0, 1]. flicker: (B, 1, H, W) in [0, 1]. others: (B, 4, 3, H, W), the
    frames of `neighbours`. flow: (B, 4, H / 2, W / 2) px, forward and backward.
    """
    rise = (high - frame).clamp(min=0).amax(1, True)
    drop = (frame - low).clamp(min=0).amax(1, True)
    change = (frame[:, None] - others).abs().amax(2)
    # A shadow multiplies the background by one number, whatever its texture; a body does not.
    ratio = torch.log((frame + DARKEST) / (background + DARKEST))
    full = torch.cat([frame * 2 - 1, (frame - background) * 4, rise * 4, drop * 4, change * 4, flicker * 16, ratio], 1)
    return full, (flow / 4).clamp(-8, 8)
