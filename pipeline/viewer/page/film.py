"""Clips that play in step: their panels lie beside each other in one video."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.vision.recordings.video import write_video

MOST_BYTES = 5_000_000  # of a film; the page that has it stays below 8 MB
MOST_WIDTH = 480  # px, of a panel
SMALLER = 0.8


@dataclass(frozen=True)
class Panel:
    """A clip: its title and frames (T, H, W, 3) uint8 RGB."""

    title: str
    frames: np.ndarray


@dataclass(frozen=True)
class Film:
    """Panels in one H.264 video.

    Attributes:
        video: The file.
        titles: Of the panels, from left to right.
        lefts: px, where each begins.
        widths: px.
        height: px.
        frames: Their number.
        fps: Frames a second.
    """

    video: bytes
    titles: tuple[str, ...]
    lefts: tuple[int, ...]
    widths: tuple[int, ...]
    height: int
    frames: int
    fps: float

    def record(self) -> dict[str, Any]:
        """What player.js reads, without the video."""
        places = zip(self.titles, self.lefts, self.widths, strict=True)
        return {
            "panels": [{"title": title, "x": x, "width": width} for title, x, width in places],
            "height": self.height,
            "frames": self.frames,
            "fps": self.fps,
        }

    def record_with_video(self) -> dict[str, Any]:
        """The same, with the video."""
        return self.record() | {"video": base64.b64encode(self.video).decode()}


def film(panels: Sequence[Panel], fps: float, most_bytes: int = MOST_BYTES, most_width: int = MOST_WIDTH) -> Film:
    """Put panels beside each other; each is brought to the height of the first.

    Args:
        panels: Of one number of frames; of others the last frames are left out.
        fps: Frames a second.
        most_bytes: Of the video, which is made smaller until it fits.
        most_width: Of the first panel, px.
    """
    count = min(len(p.frames) for p in panels)
    height, width = panels[0].frames.shape[1:3]
    scale = min(1.0, most_width / width)
    while True:
        tall = max(2, 2 * round(height * scale / 2))
        parts = [_scaled(p.frames[:count], tall) for p in panels]
        with tempfile.TemporaryDirectory(prefix="dynamics-film-") as folder:
            place = Path(folder) / "film.mp4"
            write_video(place, np.concatenate(parts, axis=2), fps)
            video = place.read_bytes()
        if len(video) <= most_bytes or tall <= 32:
            break
        scale *= SMALLER
    widths = [part.shape[2] for part in parts]
    return Film(
        video=video,
        titles=tuple(p.title for p in panels),
        lefts=tuple(int(x) for x in np.cumsum([0, *widths[:-1]])),
        widths=tuple(widths),
        height=tall,
        frames=count,
        fps=fps,
    )


def _scaled(frames: np.ndarray, height: int) -> np.ndarray:
    """Frames of that height; the width is even, as the coding of colours needs."""
    width = max(2, 2 * round(frames.shape[2] * height / frames.shape[1] / 2))
    if frames.shape[1:3] == (height, width):
        return frames
    return np.stack([cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA) for f in frames])
