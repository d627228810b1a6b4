"""Drawn clips of a camera before a picture: a body, a hand, a camera that moves, light that flickers."""

import cv2
import numpy as np

from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.video import Clip
from training.segmentation.hands import draw_hand, sample_hand

WIDTH, HEIGHT, COUNT = 240, 160, 30


def backdrop(rng: np.random.Generator, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """(H, W, 3) float32, 60 to 190: smooth patches of all sizes, so that every part has corners."""
    picture = np.zeros((height, width, 3), np.float32)
    for cells in (6, 14, 40):
        coarse = rng.uniform(-1, 1, (cells * height // width + 1, cells, 3)).astype(np.float32)
        picture += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(125 + 40 * picture, 60, 190)


def recorded(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """uint8 frames with a sensor's noise."""
    return np.clip(frames + rng.normal(0, 1.5, frames.shape), 0, 255).astype(np.uint8)


def still(rng: np.random.Generator) -> np.ndarray:
    """(T, H, W, 3) float32: nothing moves."""
    return np.stack([backdrop(rng)] * COUNT)


def with_disc(frames: np.ndarray, path: np.ndarray, radius: float, colour: tuple[int, int, int]) -> np.ndarray:
    """The frames with a disc whose centre is at path (T, 2) px."""
    out = frames.copy()
    for frame, (x, y) in zip(out, path, strict=True):
        cv2.circle(frame, (round(x * 16), round(y * 16)), round(radius * 16), colour, -1, cv2.LINE_AA, 4)
    return out


def line(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """(T, 2) px."""
    return np.linspace(start, end, COUNT)


def with_hand(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """The frames with a hand that reaches in from the border and moves about."""
    times = np.linspace(0, 1, len(frames))
    height, width = frames.shape[1:3]
    hand = sample_hand(rng, width, height, np.zeros((len(frames), 2)), 0.1 * height, times, None)
    out = frames.copy()
    for t, frame in enumerate(out):
        layer = draw_hand(hand, t, width, height)
        frame[:] = frame * (1 - layer[..., 3:]) + 255 * layer[..., :3] * layer[..., 3:]
    return out


def panned(rng: np.random.Generator, most_px: float) -> np.ndarray:
    """(T, H, W, 3) float32: a camera that turns, so that the picture shifts by so many px."""
    wide = backdrop(rng, WIDTH + int(most_px) + 2)
    shifts = most_px * np.arange(COUNT) / (COUNT - 1)
    move = [np.array([[1, 0, s], [0, 1, 0]], np.float32) for s in shifts]
    return np.stack(
        [cv2.warpAffine(wide, m, (WIDTH, HEIGHT), flags=cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR) for m in move]
    )


def flickering(rng: np.random.Generator, frames: np.ndarray, strength: float) -> np.ndarray:
    """The frames under light whose strength changes at random by so much from frame to frame."""
    return frames * (1 + strength * rng.uniform(-1, 1, (len(frames), 1, 1, 1)))


def clip(frames: np.ndarray, start: float = 0.0) -> Clip:
    """A clip of frames (T, H, W, 3) uint8 at 30 FPS that begins `start` s after its video."""
    height, width = frames.shape[1:3]
    times, size = np.arange(len(frames)) / 30, (width, height)
    return Clip(frames, times, times + start, 30.0, size, letterbox_for(size, size))
