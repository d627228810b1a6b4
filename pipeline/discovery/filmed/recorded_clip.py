"""A recorded clip with the masks and the tracks of its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack, image_tracks

MOST_LARGER = 3.0  # ratio of areas of one body in two frames


@dataclass(frozen=True)
class RecordedClip:
    """One clip of a resting camera.

    Attributes:
        name: Of the recording.
        frames: (T, H, W, 3) uint8 RGB.
        masks: (T, H, W) uint8, 0 or the body's number.
        times: (T,) s by the recording's clock.
        names: Of the bodies, in the order of their numbers, where a scene names them; empty: they have none.
    """

    name: str
    frames: np.ndarray
    masks: np.ndarray
    times: np.ndarray
    names: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """px, width and height."""
        return self.masks.shape[2], self.masks.shape[1]

    @cached_property
    def tracks(self) -> tuple[ImageTrack, ...]:
        """Of the bodies, in the order of their numbers."""
        return tuple(image_tracks(self.masks, self.times))


def way_px(track: ImageTrack) -> float:
    """px: the largest distance of the body's centre from where it was first."""
    return float(np.linalg.norm(track.centre - track.centre[0], axis=1).max())


def with_one_body(clips: Sequence[RecordedClip]) -> list[RecordedClip]:
    """The clips of one body: in each frame the mask whose area is most like the usual one is number 1, and others go.

    A ball and its shadow may exchange their numbers where they touch.
    """
    usual = np.log(np.median([max(np.median(t.area) for t in clip.tracks) for clip in clips if clip.tracks]))
    out = []
    for clip in clips:
        masks = np.zeros_like(clip.masks)
        for k, mask in enumerate(clip.masks):
            areas = np.bincount(mask.ravel(), minlength=2)[1:]
            off = np.abs(np.log(np.maximum(areas, 1)) - usual)
            if off.min() < np.log(MOST_LARGER):
                masks[k] = mask == 1 + int(off.argmin())
        out.append(replace(clip, masks=masks, names=()))
    return out
