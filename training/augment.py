"""Random augmentation of a pair of frames: exposure, colour, blur, noise, compression, mirroring."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from training.frame_pair import FramePair


def augment(rng: np.random.Generator, pair: FramePair) -> FramePair:
    """The pair as another camera and codec might record it. Only mirroring changes the flow."""
    if rng.random() < 0.5:
        pair = pair.mirrored()
    frames: list[np.ndarray] = [f.astype(np.float32) for f in (pair.frame_a, pair.frame_b)]
    both = sample_tone(rng, 0.3)
    each = [sample_tone(rng, 0.04) for _ in frames] if rng.random() < 0.2 else [(1.0, 0.0, np.ones(3), 1.0)] * 2
    frames = [tone(tone(f, *both), *own) for f, own in zip(frames, each, strict=True)]
    if rng.random() < 0.25:
        sigma = rng.uniform(0.3, 1.0)
        frames = [cv2.GaussianBlur(f, (0, 0), sigma) for f in frames]
    if rng.random() < 0.5:
        sigma = rng.uniform(0.5, 6.0)
        frames = [f + sigma * rng.standard_normal(f.shape, dtype=np.float32) for f in frames]
    pictures = [np.clip(f, 0, 255).astype(np.uint8) for f in frames]
    if rng.random() < 0.4:
        quality = int(rng.integers(50, 96))
        pictures = [compressed(p, quality) for p in pictures]
    return replace(pair, frame_a=pictures[0], frame_b=pictures[1])


def sample_tone(rng: np.random.Generator, strength: float) -> tuple[float, float, np.ndarray, float]:
    """Random contrast, brightness (0 to 255), gain of each channel (3,) and saturation, the arguments of `tone`."""
    contrast, saturation = np.exp(rng.uniform(-strength, strength, 2))
    return contrast, 255 * rng.uniform(-strength, strength) / 2, np.exp(rng.normal(size=3) * strength / 3), saturation


def tone(frame: np.ndarray, contrast: float, brightness: float, gain: np.ndarray, saturation: float) -> np.ndarray:
    """Change the tone of a frame.

    Args:
        frame: (H, W, 3) float32, 0 to 255; the result may leave that range.
        contrast: Factor about 127.5.
        brightness: Added after that.
        gain: (3,) factor of each channel.
        saturation: Factor of the distance from grey.
    """
    grey = frame.mean(axis=-1, keepdims=True)
    coloured = (grey + saturation * (frame - grey)) * gain.astype(np.float32)
    return np.float32(contrast) * (coloured - 127.5) + np.float32(127.5 + brightness)


def compressed(picture: np.ndarray, quality: int) -> np.ndarray:
    """The picture after JPEG compression."""
    _, code = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))
