"""Masks that come with a clip: which of a file's masks belong to which of its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.errors import VideoError
from pipeline.vision.recordings.mask_file import read_masks, read_times, renumbered
from pipeline.vision.recordings.video import Clip, frame_times


def given_masks(path: Path, clip: Clip, video: Path, assume_fps: float | None) -> np.ndarray:
    """Ids (T, H, W) uint8 of the frames of a clip.

    Args:
        path: An NPZ whose `times` say when each mask was recorded, or a file or folder with one mask for each frame of
            the clip or of the video.
        clip: Its frames and times.
        video: The file that it was read from.
        assume_fps: As the clip was read with.

    Raises:
        VideoError: The file cannot be read, or its masks are not those of the clip.
    """
    masks = read_masks(path, (clip.frames.shape[2], clip.frames.shape[1]), letterbox=clip.letterbox)
    times = read_times(path)
    if times is not None:
        chosen = _nearest(path, times, masks, clip)
    elif len(masks) == len(clip.frames):
        return masks
    else:
        times = frame_times(video, assume_fps)
        if len(masks) != len(times):
            raise VideoError(
                f"{path} has {len(masks)} masks; valid: {len(clip.frames)}, one for each frame of the clip that is "
                f"used, or {len(times)}, one for each frame of {video.name}"
            )
        chosen = np.abs(times - clip.source_times[:, None]).argmin(1)
    if not masks[chosen].any():
        raise VideoError(f"{path}: the masks are empty (all background) in this part of {video.name}")
    return renumbered(masks[chosen])


def _nearest(path: Path, times: np.ndarray, masks: np.ndarray, clip: Clip) -> np.ndarray:
    """(T,) the mask that is nearest in time to each frame of a clip."""
    if times.shape != (len(masks),) or not np.isfinite(times).all():
        raise VideoError(f"{path}: `times` is {times.shape}; valid: ({len(masks)},), s, one for each mask")
    apart = np.abs(times - clip.source_times[:, None])
    first, last = clip.source_times[[0, -1]]
    if apart.min(1).max() > float(np.diff(clip.times).max()):
        raise VideoError(
            f"{path} has masks from {times.min():.2f} to {times.max():.2f} s of its video; the clip needs them from "
            f"{first:.2f} to {last:.2f} s: give the same --start, --seconds and --fps to both commands"
        )
    return np.asarray(apart.argmin(1))
