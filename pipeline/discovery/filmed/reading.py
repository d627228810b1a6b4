"""Recorded clips from videos, in which the network for masks finds the bodies, and from folders that `infer` wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.bodies.mask_source import mask_source
from pipeline.bodies.user_clip import with_masks
from pipeline.bodies.video_stretch import VideoStretch, read_stretch
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.editing.filmed_clip import CLIP, read_clip
from pipeline.errors import SceneError
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene

SCENE = "scene.yaml"


def is_inferred(place: Path) -> bool:
    """Whether a folder is one that `dynamics infer` wrote."""
    return (place / CLIP).is_file()


def inferred_scene(place: Path) -> Scene:
    """The scene that `infer` found. Raises SceneError where the folder has none."""
    if not (place / SCENE).is_file():
        raise SceneError(f"{place}: there is no {SCENE}; valid: a folder that `dynamics infer` wrote")
    return load_scene(place / SCENE)


def read_recorded_clip(
    place: Path, name: str, *, start: float | None = None, seconds: float | None = None, fps: float | None = None
) -> RecordedClip:
    """Read a clip.

    Args:
        place: A video, a folder with one and its masks, or a folder that `infer` wrote.
        name: Of the recording.
        start: s, where the clip begins in the video; None: where bodies move freely.
        seconds: Its length; None: as long as they do, or 1 s from `start` on.
        fps: Frames a second at which it was shot; None for what the file says.

    Raises:
        VideoError: The clip cannot be used, or nothing moves in it.
    """
    if is_inferred(place):
        clip = read_clip(place / CLIP)
        names = tuple(o.name for o in inferred_scene(place).objects)
        return RecordedClip(name, clip.frames, clip.masks, clip.times, names)
    stretch = VideoStretch(place, start, seconds, fps)
    read, _ = read_stretch(stretch, mask_source(place, None, stretch.prompts))
    taken = with_masks(read, stretch.prompts)
    if taken.found is None:
        times = taken.clip.source_times
        return RecordedClip(name, taken.clip.frames, taken.masks, np.asarray(times - times[0]))
    found = taken.found
    return RecordedClip(name, found.clip.frames, found.masks, np.asarray(found.clip.times))
