"""A user's clip with its masks: given as files, or found by the network."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.bodies.clip_faults import clip_faults
from pipeline.bodies.found_bodies import FoundBodies, find_in_clip
from pipeline.bodies.mask_source import WEIGHTS, MaskSource
from pipeline.bodies.networks import MaskNetworks, load_mask_networks
from pipeline.bodies.prompts import Prompts
from pipeline.errors import ParamsError, naming
from pipeline.vision.recordings.clip_folder import video_of
from pipeline.vision.recordings.corrections import Correction
from pipeline.vision.recordings.given_masks import given_masks
from pipeline.vision.recordings.mask_file import renumbered, sized
from pipeline.vision.recordings.video import FPS, Clip, nearest_frames, read_clip, scaled

UNCORRECTED = Correction()
NETWORK = "the network for masks"


@dataclass(frozen=True)
class UserClip:
    """A clip and its masks.

    Attributes:
        clip: The frames that are inferred from.
        masks: (T, H, W) uint8 of these frames, 0 or the body's number.
        masks_from: `NETWORK`, a published segmenter, or the name of a file.
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


@dataclass(frozen=True)
class ReadClip:
    """A clip before its masks are known.

    Attributes:
        place: The video, or the folder with it.
        clip: The frames that are inferred from.
        source: Where its masks come from.
        filmed: The same frames in the video's own size, in which masks are looked for; None with given ones.
        assume_fps: As the clip was read with.
    """

    place: Path
    clip: Clip
    source: MaskSource
    filmed: Clip | None
    assume_fps: float | None


def read_frames(
    place: Path,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    assume_fps: float | None = None,
    source: MaskSource | None = None,
    correction: Correction = UNCORRECTED,
) -> ReadClip:
    """Read the frames of a clip as they were filmed; of a film with many a second, every second, third ….

    Args:
        place: A video, or a folder with one.
        start: Start of the clip, s.
        seconds: Length of the clip, s.
        assume_fps: Frame rate of the recording where its time stamps are wrong; None: they are used.
        source: Where its masks come from; None: our network finds them.
        correction: Of the frames.

    Raises:
        VideoError: The video cannot be used.
        ParamsError: A correction of frames whose masks are given.
    """
    video, source = video_of(place), source or MaskSource()
    if source.given is not None and correction:
        raise ParamsError(
            f"--distortion, --steady: the masks in {source.given} are those of frames that are not corrected; valid: "
            "masks that are found"
        )
    own = read_clip(video, start, seconds, fps=FPS, assume_fps=assume_fps)
    if source.given is not None:
        return ReadClip(place, scaled(own), source, None, assume_fps)
    if correction:
        with naming(str(place)):
            frames, notes = correction.apply(own.frames)
        own = replace(own, frames=frames, file_notes=[*own.file_notes, *notes])
    return ReadClip(place, scaled(own), source, own, assume_fps)


def with_masks(read: ReadClip, prompts: Prompts) -> UserClip:
    """The clip with its masks; the network for masks finds the moving bodies where they are not given.

    Raises:
        VideoError: The masks do not match the clip, or no body is found.
        ParamsError: The prompts do not fit the clip.
    """
    clip, filmed = read.clip, read.filmed
    if filmed is None:
        given = read.source.given
        assert given is not None
        ids = given_masks(given, clip, video_of(read.place), read.assume_fps)
        return UserClip(clip, ids, given.name, None, tuple(clip_faults(clip.frames, ids)))
    with naming(str(read.place)):
        found = _found(filmed, prompts, read.source)
    masks = sized(found.masks, clip.letterbox.size)
    lost = [k for k in range(1, len(found.bodies) + 1) if not (masks == k).any()]
    doubts = [f"body {k} is too small for the size at which clips are compared" for k in lost]
    return UserClip(clip, renumbered(masks), _finder(read.source), found, (*found.doubts, *doubts))


def on_grid(taken: UserClip, fps: float, count: int, size: tuple[int, int]) -> UserClip:
    """A clip as the graph's suites have theirs: the nearest frames at `count` regular times, in one size.

    Args:
        taken: Of frames as they were filmed.
        fps: Frames a second.
        count: Frames.
        size: (width, height) px.
    """
    at = nearest_frames(taken.clip, fps, count)
    clip = scaled(taken.clip if taken.found is None else taken.found.clip, size)
    again = int((np.diff(at) == 0).sum())
    notes = [f"{again} of {count} frames repeat the one before: the recording has fewer than {fps:g} a second"]
    at_times = replace(
        clip,
        frames=clip.frames[at],
        times=np.arange(count) / fps,
        source_times=clip.source_times[at],
        file_notes=[*clip.file_notes, *(notes if again else [])],
    )
    masks = taken.masks if taken.found is None else taken.found.masks
    return replace(taken, clip=at_times, masks=renumbered(sized(masks[at], size)))


def _found(filmed: Clip, prompts: Prompts, source: MaskSource) -> FoundBodies:
    if source.published is None:
        return find_in_clip(filmed, mask_networks(), prompts)
    from pipeline.bodies.published_bodies import follow_in_clip

    return follow_in_clip(filmed, mask_networks(), prompts, *source.published)


def _finder(source: MaskSource) -> str:
    """Who found the masks, in words."""
    return NETWORK if source.published is None else f"{source.published[0]} in {source.published[1]}"


@lru_cache(maxsize=1)
def mask_networks() -> MaskNetworks:
    """The networks that ship, loaded once."""
    return load_mask_networks(WEIGHTS)
