"""The frames of a clip and the masks of its bodies, as a file beside the scene that was found in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import FilmedSchedule
from pipeline.errors import VideoError
from pipeline.untrusted import read_npz

CLIP = "clip.npz"
_KEYS = ("frames", "masks", "times")


@dataclass(frozen=True)
class FilmedClip:
    """What was filmed.

    Attributes:
        frames: (T, H, W, 3) uint8 RGB.
        masks: (T, H, W) uint8: 0 background, i + 1 object i of the scene; greater numbers are bodies that the scene
            lacks.
        times: (T,) s from the first frame, when each was filmed.
    """

    frames: np.ndarray
    masks: np.ndarray
    times: np.ndarray

    @property
    def schedule(self) -> FilmedSchedule:
        """Its frames in time."""
        return FilmedSchedule.of(self.times)


def write_clip(path: Path, clip: FilmedClip) -> None:
    """Write a clip as compressed NPZ."""
    np.savez_compressed(path, frames=clip.frames, masks=clip.masks, times=clip.times)


def read_clip(path: Path) -> FilmedClip:
    """The clip that `write_clip` wrote. Raises VideoError where the file is missing, damaged or another one."""
    if not path.is_file():
        raise VideoError(f"{path}: there is no such file; valid: a folder that `dynamics infer` wrote, which has it")
    found = read_npz(path, _KEYS, VideoError)
    lacking = [key for key in _KEYS if key not in found]
    if lacking:
        raise VideoError(f"{path} is no clip of `dynamics infer`: it lacks {', '.join(lacking)}")
    frames, masks, times = (found[key].copy() for key in _KEYS)  # kernels are compiled for arrays that may be written
    fit = frames.ndim == 4 and frames.shape[-1] == 3 and masks.shape == frames.shape[:3] and len(frames) >= 2
    in_order = times.shape == frames.shape[:1] and np.isfinite(times).all() and times[0] == 0
    if not fit or frames.dtype != np.uint8 or masks.dtype != np.uint8 or not in_order or (np.diff(times) <= 0).any():
        raise VideoError(f"{path}: frames {frames.shape} {frames.dtype} and masks {masks.shape} are no clip")
    return FilmedClip(frames, masks, times)
