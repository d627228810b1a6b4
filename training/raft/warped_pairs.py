"""Pairs in which every pixel moves: layers of textures warped by smooth flows, as in FlyingChairs.

With a camera at rest most cells of a picture do not move, and a network reaches a low loss by predicting zero flow
everywhere. In these pairs every cell moves, and only the correlation shows how.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from training.frame_pair import FramePair

LONGEST_PX = 14.0  # largest shift of a layer
LAYERS = 3  # at most, beside the background
OCTAVES = (2, 4, 8, 16, 32)  # px, sizes of a texture's features


def warped_pair(rng: np.random.Generator, width: int, height: int) -> FramePair:
    """A pair of layers, each with its own texture and flow.

    Frame b shows each layer's texture T, frame a shows T(x + f(x)), so that f is exactly the flow from a to b.
    """
    y, x = np.mgrid[:height, :width].astype(np.float32)
    place = np.stack([x, y], axis=-1)
    frame_a: np.ndarray = np.zeros((height, width, 3), np.float32)
    frame_b: np.ndarray = frame_a
    flow: np.ndarray = np.zeros((height, width, 2), np.float32)
    for layer in range(1 + int(rng.integers(0, LAYERS + 1))):
        own = smooth_flow(rng, width, height)
        texture = random_texture(rng, width, height)
        shape = np.ones((height, width), np.float32) if layer == 0 else random_shape(rng, place)
        at = place + own
        moved = cv2.remap(texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        cover = cv2.remap(shape, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        frame_a = frame_a + cover[..., None] * (moved - frame_a)
        frame_b = frame_b + shape[..., None] * (texture - frame_b)
        flow = np.where(cover[..., None] > 0.5, own, flow)
    pictures = [np.clip(f, 0, 255).astype(np.uint8) for f in (frame_a, frame_b)]
    return FramePair(pictures[0], pictures[1], flow, np.ones((height, width), bool))


def smooth_flow(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 2) px: a shift, a rotation and a scaling about a random point, and a small smooth deformation."""
    direction, length = rng.uniform(0, 2 * math.pi), LONGEST_PX * rng.random() ** 1.3
    turn, growth = rng.normal() * 0.08, rng.normal() * 0.05
    y, x = np.mgrid[:height, :width].astype(np.float32)
    x, y = x - rng.uniform(0, width), y - rng.uniform(0, height)
    u = length * math.cos(direction) + growth * x - turn * y
    v = length * math.sin(direction) + growth * y + turn * x
    bend = cv2.resize(rng.normal(size=(3, 4, 2)).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return (np.stack([u, v], axis=-1) + rng.uniform(0, 1.0) * bend).astype(np.float32)


def random_texture(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3) float32, 0 to 255: noise of several sizes in a few colours, sometimes with hard edges."""
    field = np.zeros((height, width), np.float32)
    tilt = rng.normal(0.5, 0.7)
    for size in OCTAVES:
        grid = rng.normal(size=(max(2, height // size), max(2, width // size))).astype(np.float32)
        field += size**tilt * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
    field /= field.std() + 1e-6
    if rng.random() < 0.4:
        field = np.tanh(4 * field)
    base, other = rng.uniform(20, 235, (2, 3))
    strength = rng.uniform(0.05, 0.5)
    return (base + strength * field[..., None] * (other - base)).astype(np.float32)


def random_shape(rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """(H, W) float32, 0 to 1: an ellipse or a rectangle, with soft edges of 1 px."""
    height, width = place.shape[:2]
    centre = rng.uniform(0.1, 0.9, 2) * (width, height)
    half = rng.uniform(6, 24, 2)
    angle = rng.uniform(0, math.pi)
    c, s = math.cos(angle), math.sin(angle)
    local = (place - centre) @ np.array([[c, -s], [s, c]]) / half
    reach = np.abs(local).max(-1) if rng.random() < 0.5 else np.linalg.norm(local, axis=-1)
    return np.clip(0.5 + (1 - reach) * half.min(), 0, 1).astype(np.float32)
