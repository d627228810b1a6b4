"""The network's answers for a whole clip."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from pipeline.bodies.networks.inputs import ClipFeatures, flows_at, neighbours, network_input
from pipeline.bodies.networks.network import BODY, MOVING, OTHER, VOTE_SCALE_PX, SegmentationNetwork, without_norms
from pipeline.compiled import kernel

BATCH = 6  # frames at once
ALIKE = 10  # of 255: a pixel whose colour differs by less from another frame's shows the same there
STEADY_SHARE = 0.5  # of the answer that is the mean over the frames in which the pixel looks alike
LOG_RADIUS = (-1.0, 6.0)


@dataclass(frozen=True)
class Prediction:
    """moving, body, other: probabilities (T, H, W) float32, as `network` names them. vote: (T, H, W, 2) px, where each
    pixel says that its body's centre is; radius: (T, H, W) px, of that body."""

    moving: np.ndarray
    body: np.ndarray
    other: np.ndarray
    vote: np.ndarray
    radius: np.ndarray


@torch.inference_mode()
def predict(network: SegmentationNetwork, frames: np.ndarray, features: ClipFeatures) -> Prediction:
    """The answers for a clip (T, H, W, 3) uint8, H and W multiples of `network.STRIDE`, and its features."""
    count, height, width = frames.shape[:3]
    pictures = torch.from_numpy(frames).permute(0, 3, 1, 2)
    background, low, high = (_picture(p) for p in (features.background, features.low, features.high))
    flicker = torch.from_numpy(features.flicker)[None, None].float() / 255
    ready = without_norms(network)
    probability = np.empty((3, count, height, width), np.float32)
    vote = np.empty((count, height, width, 2), np.float32)
    radius = np.empty((count, height, width), np.float32)
    rows, cols = np.mgrid[:height, :width].astype(np.float32) + 0.5
    for first in range(0, count, BATCH):
        at = range(first, min(first + BATCH, count))
        others = torch.stack([pictures[list(neighbours(t, count))] for t in at]).float() / 255
        flow = torch.stack([torch.from_numpy(np.concatenate(flows_at(features, t), -1)) for t in at])
        frame = pictures[first : at.stop].float() / 255
        level = flicker.expand(len(at), -1, height, width)
        shown = network_input(frame, background, low, high, level, others, flow.permute(0, 3, 1, 2))
        logits, votes = ready(*(x.contiguous(memory_format=torch.channels_last) for x in shown))
        probability[:, first : at.stop] = torch.sigmoid(logits).permute(1, 0, 2, 3).numpy()
        for t, answer in zip(at, votes.permute(0, 2, 3, 1).numpy(), strict=True):
            large = cv2.resize(answer, (width, height), interpolation=cv2.INTER_LINEAR)
            vote[t, ..., 0] = cols + VOTE_SCALE_PX * large[..., 0]
            vote[t, ..., 1] = rows + VOTE_SCALE_PX * large[..., 1]
            radius[t] = np.exp(np.clip(large[..., 2], *LOG_RADIUS))
    return Prediction(probability[MOVING], probability[BODY], probability[OTHER], vote, radius)


def _picture(picture: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(picture)).permute(2, 0, 1)[None].float() / 255


@kernel
def _steadied(probability: np.ndarray, frames: np.ndarray, out: np.ndarray) -> None:
    count, height, width = probability.shape
    for row in range(height):
        for col in range(width):
            largest = 0.0
            for t in range(count):
                largest = max(largest, probability[t, row, col])
            for t in range(count):
                own = probability[t, row, col]
                if largest < 0.05:
                    out[t, row, col] = own
                    continue
                total, weight = 0.0, 0
                for s in range(count):
                    if (
                        abs(np.int64(frames[s, row, col, 0]) - np.int64(frames[t, row, col, 0])) < ALIKE
                        and abs(np.int64(frames[s, row, col, 1]) - np.int64(frames[t, row, col, 1])) < ALIKE
                        and abs(np.int64(frames[s, row, col, 2]) - np.int64(frames[t, row, col, 2])) < ALIKE
                    ):
                        total += probability[s, row, col]
                        weight += 1
                out[t, row, col] = (1 - STEADY_SHARE) * own + STEADY_SHARE * total / weight


def steadied(probability: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Probabilities (T, H, W), each pixel's mixed with what is said of it in the frames in which it looks alike."""
    out = np.empty_like(probability)
    _steadied(probability, frames, out)
    return out
