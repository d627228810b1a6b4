"""A user's clip with its masks: given beside the video, or found from motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import VideoError
from pipeline.vision.dis import DIS
from pipeline.vision.mask_file import read_masks
from pipeline.vision.motion_masks import masks_from_motion
from pipeline.vision.video import Clip, read_clip

VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


@dataclass(frozen=True)
class UserClip:
    """The clip, its masks (T, H, W) uint8 and where they came from: "motion" or a file's name."""

    clip: Clip
    masks: np.ndarray
    masks_from: str


def find_clips(folder: Path) -> list[Path]:
    """The clips of a folder in the order of their names: videos, and folders that hold a video. Raises `VideoError`."""
    if not folder.is_dir():
        raise VideoError(f"suites.real.path: {folder} is no folder; valid: a folder of videos, or null")
    return [p for p in sorted(folder.iterdir()) if _is_video(p) or (p.is_dir() and any(map(_is_video, p.iterdir())))]


def _is_video(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES


def read_user_clip(
    place: Path, start: float, seconds: float, fps: float, assume_fps: float | None, masks: Path | None = None
) -> UserClip:
    """The clip at `place`, a video or a folder with one and its masks. `masks`: a mask file or folder to use instead.

    Raises `VideoError` for a video that cannot be used, masks that do not fit, or a clip in which nothing moves.
    """
    video = place if not place.is_dir() else next(p for p in sorted(place.iterdir()) if _is_video(p))
    if masks is None and place.is_dir():
        masks = next((p for p in (place / "masks.npz", place / "masks") if p.exists()), None)
    clip = read_clip(video, start, seconds, fps, assume_fps=assume_fps)
    if masks is None:
        return UserClip(clip, masks_from_motion(clip.frames, DIS("medium").flow(clip.frames[:-1], clip.frames[1:])), "motion")
    size = (clip.frames.shape[2], clip.frames.shape[1])
    return UserClip(clip, read_masks(masks, size, len(clip.frames), clip.fit), masks.name)
