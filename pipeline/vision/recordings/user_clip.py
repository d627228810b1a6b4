"""A clip of a user with its masks, which are given as files or found from motion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import VideoError
from pipeline.vision.flow.dis import DIS
from pipeline.vision.recordings.mask_file import read_masks
from pipeline.vision.recordings.motion_masks import masks_from_motion
from pipeline.vision.recordings.video import Clip, frame_times, read_clip

VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg")


@dataclass(frozen=True)
class UserClip:
    """A clip, its masks (T, H, W) uint8, and their source: "motion" or the name of a file."""

    clip: Clip
    masks: np.ndarray
    masks_from: str


def find_clips(folder: Path) -> list[Path]:
    """The clips of a folder in the order of their names: videos, and folders with a video. Raises VideoError."""
    if not folder.is_dir():
        raise VideoError(f"suites.real.path: {folder} is not a folder; valid: a folder of videos, or null")
    return [p for p in sorted(folder.iterdir()) if _is_video(p) or (p.is_dir() and any(map(_is_video, p.iterdir())))]


def _is_video(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES


def read_user_clip(
    place: Path, start: float, seconds: float, fps: float, assume_fps: float | None, masks: Path | None = None
) -> UserClip:
    """Read a clip and its masks; without masks, moving objects are segmented by their motion.

    Args:
        place: A video, or a folder with a video and possibly `masks.npz` or a folder `masks`.
        start: Start of the clip, s.
        seconds: Length of the clip, s.
        fps: Frame rate of the clip.
        assume_fps: Frame rate of the recording where its time stamps are wrong; None: they are used.
        masks: Mask file or folder to use instead, with one mask per frame of the clip or of the recording.

    Raises:
        VideoError: The video cannot be used, the masks do not match it, or nothing moves.
    """
    video = _video_of(place)
    if masks is None and place.is_dir():
        masks = next((p for p in (place / "masks.npz", place / "masks") if p.exists()), None)
    clip = read_clip(video, start, seconds, fps, assume_fps=assume_fps)
    if masks is None:
        flow = DIS("medium").flow(clip.frames[:-1], clip.frames[1:])
        return UserClip(clip, masks_from_motion(clip.frames, flow), "motion")
    return UserClip(clip, _given_masks(masks, clip, video, assume_fps), masks.name)


def _video_of(place: Path) -> Path:
    if not place.is_dir():
        return place
    videos = [p for p in sorted(place.iterdir()) if _is_video(p)]
    if not videos:
        raise VideoError(f"{place} has no video; valid: a file with one of {', '.join(VIDEO_SUFFIXES)}")
    return videos[0]


def _given_masks(path: Path, clip: Clip, video: Path, assume_fps: float | None) -> np.ndarray:
    """Masks (T, H, W) uint8 of the frames of the clip, from a file with one mask per frame of clip or recording."""
    masks = read_masks(path, (clip.frames.shape[2], clip.frames.shape[1]), letterbox=clip.letterbox)
    if len(masks) == len(clip.frames):
        return masks
    times = frame_times(video, assume_fps)
    if len(masks) != len(times):
        raise VideoError(
            f"{path} has {len(masks)} masks; valid: {len(clip.frames)}, one for each frame of the clip at "
            f"{1 / clip.times[1]:g} FPS, or {len(times)}, one for each frame of {video.name}"
        )
    masks = masks[np.abs(times - clip.source_times[:, None]).argmin(1)]
    values = np.unique(np.append(0, masks))
    if len(values) == 1:
        raise VideoError(f"{path}: the masks are empty (all background) in this part of {video.name}")
    return np.searchsorted(values, masks).astype(np.uint8)
