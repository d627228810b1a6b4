"""A body that goes on under another number, since it moved too far between two frames to be followed.

A body neither vanishes nor comes into being in the middle of the picture. Where the one body ends whole in one frame,
and an equal one begins whole in the next, they are one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.bodies.tracks.exchanged_bodies import alike
from pipeline.bodies.tracks.image_track import SAME_SIZE, ImageTrack, image_tracks


def continued_bodies(
    masks: np.ndarray, frames: np.ndarray, times: np.ndarray, known: Sequence[bool]
) -> tuple[np.ndarray, list[list[int]]]:
    """Masks in which a body keeps its number, and the bodies, by index, of which each is made.

    Args:
        masks: (T, H, W) ids from 1.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s.
        known: Of each body, whether the user pointed at it; these are not joined.
    """
    tracks = {t.body: t for t in image_tracks(masks, times) if not known[t.body - 1]}
    groups = [[k] for k in range(len(known))]
    for end in range(len(masks) - 1):
        ended = [t for t in tracks.values() if t.frames[-1] == end and t.whole[-1]]
        begun = [t for t in tracks.values() if t.frames[0] == end + 1 and t.whole[0]]
        if len(ended) == len(begun) == 1 and _equal(ended[0], begun[0]) and alike(masks, frames, ended[0], begun[0]):
            one, other = (next(g for g in groups if t.body - 1 in g) for t in (ended[0], begun[0]))
            groups = [g if g is not one else one + other for g in groups if g is not other]
    numbers = np.zeros(len(known) + 1, masks.dtype)
    for number, group in enumerate(groups, 1):
        numbers[np.array(group) + 1] = number
    return numbers[masks], groups


def _equal(one: ImageTrack, other: ImageTrack) -> bool:
    return abs(np.log(one.radius / other.radius)) < SAME_SIZE
