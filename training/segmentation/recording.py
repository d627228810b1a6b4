"""What a camera and a file make of pictures: exposure, flicker, noise, blur, shake, compression, captions, bars."""

from __future__ import annotations

import io
import math
from fractions import Fraction

import av
import cv2
import numpy as np

from training.segmentation.backgrounds import log_uniform, put_text

_NO_AVX512 = {"x264-params": "asm=sse4.2"}  # else x264's bytes vary from run to run


def compressed(frames: np.ndarray, crf: int, preset: str = "veryfast") -> np.ndarray:
    """The frames (T, H, W, 3) uint8 after H.264 of that quality."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        options = {"crf": str(crf), "preset": preset, "threads": "1"} | _NO_AVX512
        stream = container.add_stream("libx264", rate=Fraction(30), options=options)
        stream.width, stream.height, stream.pix_fmt = frames.shape[2], frames.shape[1], "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())
    buffer.seek(0)
    with av.open(buffer, "r") as coded:
        return np.stack([f.to_ndarray(format="rgb24") for f in coded.decode(video=0)])


def exposure(rng: np.random.Generator, count: int, height: int) -> np.ndarray:
    """Gains float32 (T, H, 1, 3): steady, drifting (auto-exposure, white balance), flickering, in bands."""
    gain = np.ones((count, height, 1, 3), np.float32)
    t = np.arange(count)
    if rng.random() < 0.25:  # auto-exposure
        drift = np.interp(t, np.sort(rng.uniform(0, count, 4)), 1 + rng.normal(0, 0.05, 4))
        gain *= drift[:, None, None, None]
    if rng.random() < 0.1:  # white balance
        gain *= 1 + np.linspace(0, 1, count)[:, None, None, None] * rng.normal(0, 0.03, 3)
    if rng.random() < 0.2:  # lamps
        wave = log_uniform(rng, 0.002, 0.05) * np.sin(t * rng.uniform(0.1, 3.0) + rng.uniform(0, 6))
        gain *= 1 + (wave + rng.normal(0, 0.005, count))[:, None, None, None]
    if rng.random() < 0.08:  # lamps under a rolling shutter
        phase = rng.uniform(0, 6) + t[:, None] * rng.uniform(0, 3) + np.arange(height) / height * rng.uniform(2, 20)
        gain *= 1 + log_uniform(rng, 0.005, 0.05) * np.sin(phase)[..., None, None]
    return gain.astype(np.float32)


def add_noise(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """Float32 frames (T, H, W, 3), 0 to 255, with shot and read noise, some of it coloured, coarse or striped."""
    level = 255 * float(
        rng.choice([rng.uniform(0, 0.006), rng.uniform(0.005, 0.02), rng.uniform(0.015, 0.05)], p=[0.4, 0.4, 0.2])
    )
    shot, grey = rng.uniform(0, 1), rng.random() < 0.3
    coarse = float(rng.choice([0.0, rng.uniform(0.5, 1.2)], p=[0.6, 0.4]))
    out = np.empty_like(frames)
    for t, frame in enumerate(frames):
        noise = rng.standard_normal((*frame.shape[:2], 1 if grey else 3), dtype=np.float32)
        if coarse:
            noise = cv2.GaussianBlur(noise, (0, 0), coarse).reshape(noise.shape) * (1 + 2 * coarse)
        weight = level * ((1 - shot) + shot * np.sqrt(np.clip(frame, 0, 255) / 128))
        out[t] = frame + weight * noise
    if rng.random() < 0.1:  # rows or columns of the sensor that differ from frame to frame
        out += rng.normal(0, 0.5 * level + 0.5, (len(frames), frames.shape[1], 1, 1)).astype(np.float32)
    return out


def shaken(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """The frames (T, H, W, 3) moved by less than a pixel or so, as on a table that trembles."""
    count, height, width = frames.shape[:3]
    walk = np.cumsum(rng.normal(0, 1, (count, 2)), 0) if rng.random() < 0.5 else rng.normal(0, 1, (count, 2))
    walk *= rng.uniform(0.1, 0.7) / (np.abs(walk).max() + 1e-6)
    moves = [np.array([[1, 0, x], [0, 1, y]], np.float32) for x, y in walk]
    return np.stack(
        [
            cv2.warpAffine(f, m, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for f, m in zip(frames, moves, strict=True)
        ]
    )


def captioned(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """The uint8 frames with a text or a panel in the first or last one or two."""
    out = frames.copy()
    count = int(rng.integers(1, 3))
    which = np.arange(count) if rng.random() < 0.6 else len(frames) - 1 - np.arange(count)
    panel = frames[0].astype(np.float32) / 255
    height, width = panel.shape[:2]
    if rng.random() < 0.5:
        x, y = int(rng.uniform(0, 0.6) * width), int(rng.uniform(0, 0.7) * height)
        colour = tuple(float(c) for c in rng.uniform(0, 1, 3))
        cv2.rectangle(
            panel,
            (x, y),
            (x + int(rng.uniform(0.1, 0.6) * width), y + int(rng.uniform(0.05, 0.3) * height)),
            colour,
            -1,
        )
    put_text(rng, panel)
    drawn = np.abs(panel - frames[0].astype(np.float32) / 255).max(-1) > 0.02
    for t in which:
        out[t][drawn] = (255 * panel[drawn]).astype(np.uint8)
    return out


def letterboxed(rng: np.random.Generator, pictures: list[np.ndarray], share: float) -> list[np.ndarray]:
    """Pictures cut to the middle of their width, with bars as in `pipeline.vision.recordings`, or black ones.

    Args:
        rng: Chooses the kind of bars.
        pictures: Each (T, H, W, ...) uint8.
        share: Of the width that is kept.

    Returns:
        The pictures at their old size. Bars have the median colour of the border, of masks 0.
    """
    width = pictures[0].shape[2]
    left = round(width * (1 - share) / 2)
    black = rng.random() < 0.3
    out = []
    for picture in pictures:
        kept = picture[:, :, left : width - left]
        boxed = np.zeros_like(picture)
        if picture.ndim == 4 and not black:
            border = np.concatenate([kept[:, 0], kept[:, -1], kept[:, :, 0], kept[:, :, -1]], 1)
            boxed[:] = np.median(border, axis=1)[:, None, None]
        boxed[:, :, left : width - left] = kept
        out.append(boxed)
    return out


def recorded(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """Frames float32 (T, H, W, 3), 0 to 255, as a camera and a file give them: uint8 (T, H, W, 3)."""
    count, height, width = frames.shape[:3]
    blur = float(rng.choice([0.0, rng.uniform(0.3, 1.0), rng.uniform(0.8, 1.8)], p=[0.4, 0.5, 0.1]))
    if blur:
        frames = np.stack([cv2.GaussianBlur(f, (0, 0), blur) for f in frames])
    tone = np.clip(frames / 255, 0, 1) ** math.exp(rng.normal(0, 0.2))
    tone = 0.5 + rng.uniform(0.7, 1.25) * (tone - 0.5) + rng.normal(0, 0.05)
    if rng.random() < 0.3:
        grey = tone.mean(-1, keepdims=True)
        tone = grey + float(rng.choice([0.0, rng.uniform(0.2, 0.8), rng.uniform(1.1, 1.6)])) * (tone - grey)
    y, x = np.mgrid[:height, :width]
    corner = ((x / width - 0.5) ** 2 + (y / height - 0.5) ** 2)[..., None]
    frames = (
        255 * tone * (1 - float(rng.uniform(0, 0.8) * (rng.random() < 0.5)) * corner) * exposure(rng, count, height)
    )
    if rng.random() < 0.15:
        frames = shaken(rng, frames.astype(np.float32))
    out = np.clip(add_noise(rng, frames.astype(np.float32)) + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < 0.04:
        out = captioned(rng, out)
    if rng.random() < 0.7:
        out = compressed(out, int(rng.integers(14, 36)), str(rng.choice(["veryfast", "ultrafast"])))
    return np.ascontiguousarray(out)
