"""Windows of training clips, augmented, as the network's inputs and targets."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor

from pipeline.bodies.networks.inputs import FAR, NEAR, flows_at, neighbours
from pipeline.bodies.networks.network import VOTE_SCALE_PX
from pipeline.bodies.networks.plate import clear_plate
from training.segmentation.clip import BODY_SHADOW, MOVES, RESTS, UNSEEN, UNSURE, TrainingClip

LEAST_RADIUS_PX = 0.5
MISSED, MISSED_FOR_A_WHILE = 0.1, 0.4  # probability that a first look finds a body in no frame; not in some
RESTING_WEIGHT = 0.3  # of the votes for bodies that do not move


@dataclass(frozen=True)
class Sample:
    """Inputs as `network_input` takes them, without the batch: frame, background, low, high (3, h, w), flicker
    (1, h, w), others (4, 3, h, w), flow (4, h / 2, w / 2). Targets: moving, body (h, w), 0 or 1; other (h, w), as
    `clip` labels it; known (h, w), 0 where `moving` does not count; visible (h, w), 0 where `body` does not; offset
    (2, h / 2, w / 2) in VOTE_SCALE_PX, log_radius and weight (h / 2, w / 2)."""

    frame: np.ndarray
    background: np.ndarray
    low: np.ndarray
    high: np.ndarray
    flicker: np.ndarray
    others: np.ndarray
    flow: np.ndarray
    moving: np.ndarray
    body: np.ndarray
    other: np.ndarray
    known: np.ndarray
    visible: np.ndarray
    offset: np.ndarray
    log_radius: np.ndarray
    weight: np.ndarray


def tone_table(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A table (256, 3) of display values in [0, 1], and an order of the channels (3,)."""
    steps = np.arange(256) / 255
    gamma, shift, contrast = math.exp(rng.normal(0, 0.2)), rng.normal(0, 0.04), math.exp(rng.normal(0, 0.15))
    columns = [
        np.clip(contrast * math.exp(rng.normal(0, 0.06)) * (steps**gamma - 0.5) + 0.5 + shift, 0, 1) for _ in range(3)
    ]
    return np.stack(columns, 1).astype(np.float32), rng.permutation(3) if rng.random() < 0.5 else np.arange(3)


def sample_window(
    rng: np.random.Generator, clip: TrainingClip, t: int, size: tuple[int, int], zoom: float
) -> tuple[int, int, int, int]:
    """(left, top, width, height) of a window that is zoomed to `size` (width, height) px; most are near a body, or near
    what moves and is none."""
    height, width = clip.mask.shape[1:]
    w, h = min(round(size[0] / zoom / 2) * 2, width), min(round(size[1] / zoom / 2) * 2, height)
    left, top = int(rng.integers(0, width - w + 1)), int(rng.integers(0, height - h + 1))
    near = [c for c in clip.centre[t] if 0 < c[0] < width and 0 < c[1] < height]
    rows, cols = np.nonzero(clip.other[t] > 0)
    if len(rows) and rng.random() < 0.4:
        pick = int(rng.integers(len(rows)))
        near = [np.array([cols[pick], rows[pick]])]
    if near and rng.random() < 0.75:
        centre = near[int(rng.integers(len(near)))]
        left = int(np.clip(centre[0] - rng.uniform(0.15, 0.85) * w, 0, width - w))
        top = int(np.clip(centre[1] - rng.uniform(0.15, 0.85) * h, 0, height - h))
    return left // 2 * 2, top // 2 * 2, w, h


def draw_sample(
    rng: np.random.Generator, clip: TrainingClip, t: int, size: tuple[int, int] | None, augment: bool
) -> Sample:
    """Frame t of a clip in a random window of `size` (width, height) px; None: the whole frame."""
    count, height, width = clip.mask.shape
    zoom = 1.0
    if size is None:
        left, top, w, h = 0, 0, width, height
        size = (width, height)
    else:
        if augment and rng.random() < 0.3:
            zoom = math.exp(rng.uniform(math.log(0.75), math.log(2.2)))
        left, top, w, h = sample_window(rng, clip, t, size, zoom)
    resized = (w, h) != size
    scale = np.array([size[0] / w, size[1] / h], np.float32)
    window = (slice(top, top + h), slice(left, left + w))
    half = (slice(top // 2, (top + h) // 2), slice(left // 2, (left + w) // 2))
    table, order = (
        tone_table(rng) if augment else (np.repeat(np.arange(256, dtype=np.float32)[:, None] / 255, 3, 1), np.arange(3))
    )

    def picture(source: np.ndarray) -> np.ndarray:
        cut = source[window]
        if resized:
            cut = cv2.resize(cut, size, interpolation=cv2.INTER_LINEAR)
        return np.stack([table[cut[..., c], i] for i, c in enumerate(order)])

    def labels(source: np.ndarray) -> np.ndarray:
        cut = source[window]
        return cv2.resize(cut, size, interpolation=cv2.INTER_NEAREST_EXACT) if resized else cut

    near, far = NEAR, FAR
    if augment and rng.random() < 0.4:
        near, far = int(rng.integers(1, 4)), int(rng.integers(4, 10))
    beside = list(neighbours(t, count, near, far))
    forward, backward = flows_at(clip.features, t)
    if augment and rng.random() < 0.5:  # time runs backwards
        beside = [beside[1], beside[0], beside[3], beside[2]]
        forward, backward = backward, forward
    flow = np.concatenate([forward[half], backward[half]], -1)
    if resized:
        flow = cv2.resize(flow, (size[0] // 2, size[1] // 2), interpolation=cv2.INTER_LINEAR) * np.tile(scale, 2)
    flow = flow.transpose(2, 0, 1)
    mask = labels(clip.mask[t])
    flicker = labels(clip.flicker).astype(np.float32)[None] / 255
    state = np.concatenate([[RESTS], clip.state])[mask]
    small = mask[::2, ::2]
    rows, cols = np.mgrid[: small.shape[0], : small.shape[1]].astype(np.float32) * 2 + 0.5
    centre = np.concatenate([np.zeros((1, 2)), (clip.centre[t] - [left, top]) * scale])[small]
    offset = np.stack([centre[..., 0] - cols, centre[..., 1] - rows]) / VOTE_SCALE_PX
    radius = np.concatenate([[1.0], clip.radius[t] * float(np.sqrt(scale.prod()))])[small]
    area = np.bincount(small.ravel(), minlength=len(clip.state) + 1).astype(np.float32)
    seen = (small > 0) & (state[::2, ::2] != UNSEEN)
    fields = [
        *(picture(p) for p in (clip.frames[t], clip.background, clip.low, clip.high)),
        flicker,
        np.stack([picture(clip.frames[k]) for k in beside]),
        flow,
        (mask > 0) & (state == MOVES),
        mask > 0,
        labels(clip.other[t].astype(np.uint8)),
        (state != UNSURE) & (state != UNSEEN),
        state != UNSEEN,
        offset,
        np.log(np.maximum(radius, LEAST_RADIUS_PX)),
        np.where(seen, np.where(state[::2, ::2] == MOVES, 1, RESTING_WEIGHT) / np.sqrt(area[small] + 20), 0),
    ]
    if augment and rng.random() < 0.5:
        fields = [f[..., ::-1] for f in fields]
        fields[6] = fields[6] * np.array([-1, 1, -1, 1], np.float32)[:, None, None]
        fields[12] = fields[12] * np.array([-1, 1], np.float32)[:, None, None]
    if augment and rng.random() < 0.25:
        fields = [f[..., ::-1, :] for f in fields]
        fields[6] = fields[6] * np.array([1, -1, 1, -1], np.float32)[:, None, None]
        fields[12] = fields[12] * np.array([1, -1], np.float32)[:, None, None]
    return Sample(*(np.ascontiguousarray(f, np.float32) for f in fields))


def with_clear_plate(rng: np.random.Generator, clip: TrainingClip) -> TrainingClip:
    """The clip with the background that its moving bodies leave, most of them found in most frames."""
    count = len(clip.frames)
    covered = np.zeros(clip.mask.shape, bool)
    for body in 1 + np.flatnonzero(clip.state == MOVES):
        if rng.random() < MISSED:
            continue
        found = np.ones(count, bool)
        if rng.random() < MISSED_FOR_A_WHILE:
            first = int(rng.integers(count))
            found[first : first + int(rng.integers(1, max(count // 2, 2)))] = False
        covered |= (clip.mask == body) & found[:, None, None]
    if rng.random() < 0.3:  # shadows too
        covered |= clip.other == BODY_SHADOW
    return replace(clip, background=clear_plate(clip.frames, covered, clip.background)[0])


def batched(samples: list[Sample]) -> dict[str, Tensor]:
    """The fields of samples of one size, stacked."""
    names = Sample.__dataclass_fields__
    return {name: torch.from_numpy(np.stack([getattr(s, name) for s in samples])) for name in names}
