"""A user's clip with its masks: given as files, or found by the network."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.errors import ParamsError, VideoError, naming
from pipeline.inference.clip_faults import clip_faults
from pipeline.inference.found_bodies import FoundBodies, find_in_clip
from pipeline.inference.prompts import Prompts
from pipeline.segmentation.network import SegmentationNetwork, load_network
from pipeline.vision.recordings.clip_folder import masks_beside, video_of
from pipeline.vision.recordings.given_masks import given_masks
from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.mask_file import letterboxed, renumbered
from pipeline.vision.recordings.video import Clip, read_clip, resampled

WEIGHTS = Path(__file__).resolve().parents[2] / "models" / "masks"  # the network that ships
LEAST_FRAMES = 30  # in which the network looks for bodies, where so many were filmed
NETWORK = "the network for masks"


@dataclass(frozen=True)
class UserClip:
    """A clip and its masks.

    Attributes:
        clip: The frames that are inferred from.
        masks: (T, H, W) uint8 of these frames, 0 or the body's number.
        masks_from: `NETWORK`, or the name of a file.
        found: The bodies as they were found, in the video's own size; None where masks were given.
        doubts: What may be wrong with them, a sentence each.
    """

    clip: Clip
    masks: np.ndarray
    masks_from: str
    found: FoundBodies | None
    doubts: tuple[str, ...]

    @property
    def objects(self) -> int:
        """How many bodies the masks have."""
        return int(self.masks.max(initial=0))


def read_user_clip(
    place: Path,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float = 30.0,
    assume_fps: float | None = None,
    masks: Path | None = None,
    prompts: Prompts | None = None,
) -> UserClip:
    """Read a clip and its masks; where none are given, the network for masks finds the moving bodies.

    Args:
        place: A video, or a folder with a video and possibly `masks.npz` or a folder `masks`.
        start: Start of the clip, s.
        seconds: Length of the clip, s.
        fps: Frame rate of the clip.
        assume_fps: Frame rate of the recording where its time stamps are wrong; None: they are used.
        masks: Mask file or folder to use instead of those beside the video.
        prompts: What the user says of the bodies; then masks beside the video are not used.

    Raises:
        VideoError: The video cannot be used, the masks do not match it, or no body is found.
        ParamsError: The prompts do not fit the clip, or masks are given as well.
    """
    prompts = prompts or Prompts()
    if prompts and masks is not None:
        raise ParamsError(
            f"--masks {masks}: points, boxes and numbers of objects are for masks that are found; give one"
        )
    given = masks if masks is not None or prompts else masks_beside(place)
    if given is None:
        return find_user_clip(place, start=start, seconds=seconds, fps=fps, assume_fps=assume_fps, prompts=prompts)
    clip = read_clip(video_of(place), start, seconds, fps, assume_fps=assume_fps)
    ids = given_masks(given, clip, video_of(place), assume_fps)
    return UserClip(clip, ids, given.name, None, tuple(clip_faults(clip.frames, ids)))


def find_user_clip(
    place: Path,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float = 30.0,
    assume_fps: float | None = None,
    prompts: Prompts | None = None,
) -> UserClip:
    """Read a clip and find its bodies, whatever masks lie beside it; arguments and errors as of `read_user_clip`.

    Bodies are looked for in the video's own size, in the frames at `fps`, or at the least multiple of it that gives
    LEAST_FRAMES, so that a short clip in slow motion has enough; of a video with fewer frames, in all of them.
    """
    every = max(math.ceil(LEAST_FRAMES / max(round(seconds * fps), 1)), 1)
    own = read_clip(video_of(place), start, seconds, fps * every, size=None, assume_fps=assume_fps)
    clip = resampled(own, every)
    distinct = np.unique(own.source_times, return_index=True)[1]
    filmed = replace(
        own,
        frames=own.frames[distinct],
        times=own.source_times[distinct] - own.source_times[0],
        source_times=own.source_times[distinct],
    )
    with naming(str(place)):
        if len(distinct) < 2:
            raise VideoError("the clip has one frame only; at least two are needed")
        found = find_in_clip(filmed, mask_network(), prompts or Prompts())
        at = np.searchsorted(filmed.source_times, clip.source_times)
        height, width = found.masks.shape[1:]
        masks = letterboxed(found.masks[at], letterbox_for((width, height), clip.letterbox.size)[0])
        if not masks.any():
            raise VideoError(
                "the moving bodies are outside of the part of the picture that is used, or too small for it"
            )
    return UserClip(clip, renumbered(masks), NETWORK, found, found.doubts)


@lru_cache(maxsize=1)
def mask_network() -> SegmentationNetwork:
    """The network that ships, loaded once."""
    return load_network(WEIGHTS)
