"""A stretch of a video that is to be measured, and its reading."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from pipeline.bodies.free_motion import Stretch, stretch_of
from pipeline.bodies.mask_source import MaskSource
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import ReadClip, mask_networks, read_frames
from pipeline.vision.recordings.clip_folder import video_of
from pipeline.vision.recordings.corrections import Correction


@dataclass(frozen=True)
class VideoStretch:
    """A stretch of a video.

    Attributes:
        place: The video, or a folder with one and masks.
        start: s, where the stretch begins; None: where bodies move freely.
        seconds: Its length; None: as long as they do, or 1 s from `start` on.
        fps: Frames a second at which it was shot; None for what the file says.
        masks: A file or folder of masks, or a published segmenter; None for masks beside the video, else our network.
        prompts: What is known of the bodies.
        correction: Of the frames.
    """

    place: Path
    start: float | None = None
    seconds: float | None = None
    fps: float | None = None
    masks: str | Path | None = None
    prompts: Prompts = field(default_factory=Prompts)
    correction: Correction = field(default_factory=Correction)


def read_stretch(clip: VideoStretch, source: MaskSource) -> tuple[ReadClip, Stretch]:
    """Read the frames of a stretch; of a long video, choose it first.

    Raises:
        VideoError: The video cannot be used.
        ParamsError: A correction of frames whose masks are given.
    """
    part = stretch_of(
        video_of(clip.place),
        lambda: mask_networks().moving,
        start=clip.start,
        seconds=clip.seconds,
        assume_fps=clip.fps,
        masks=source.given,
    )
    read = read_frames(
        clip.place,
        start=part.start,
        seconds=part.seconds,
        assume_fps=clip.fps,
        source=source,
        correction=clip.correction,
    )
    return read, part
