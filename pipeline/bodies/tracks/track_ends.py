"""Frames before a track begins and after it ends, in which its body is seen where it was to be expected.

The network is weakest in the first and the last frames, and where a body leaves the picture. There, what differs from
the background at the expected place, in the body's size and colour, is the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.tracks.resting import covered

MOST_FRAMES = 3  # at each end
PART = 0.5  # of the track's median area: less is a part of the body
REACH = 1.25  # radii about the expected centre, within which the body is looked for
LEAST_AREA, MOST_AREA = 0.75, 1.6  # of the track's median area, while the picture's border does not cut the body
NEAR_COLOUR = 0.06  # most difference of a pixel's colour from one that the track has had, in [0, 1]
CLOSE = 1.0  # radii: most distance of what is found from where it was expected


def with_all_ends(tracks: Sequence[Track], frames: np.ndarray, changed: np.ndarray) -> list[Track]:
    """The tracks of a clip's bodies, each as of `with_ends` beside all others."""
    return [with_ends(k, frames, changed, [other for other in tracks if other is not k]) for k in tracks]


def with_ends(track: Track, frames: np.ndarray, changed: np.ndarray, others: Sequence[Track] = ()) -> Track:
    """The track with up to MOST_FRAMES more pieces before it and after it; of its own, parts at the ends are completed.

    Args:
        track: As it was followed.
        frames: (T, H, W, 3) uint8.
        changed: (T, H, W) bool, where they differ from the background by more than a shadow.
        others: Tracks of other bodies, whose pixels are not its own.
    """
    pieces = dict(track.pieces)
    least = PART * track.typical_area
    for step in (-1, 1):
        parts: dict[int, Piece] = {}  # in which only a part of the body was seen
        while len(pieces) > 2 and len(pieces[end := (min if step < 0 else max)(pieces)].pixels) < least:
            parts[end] = pieces.pop(end)
        for _ in range(MOST_FRAMES + len(parts)):
            t = (min(pieces) if step < 0 else max(pieces)) + step
            if not 0 <= t < len(frames) or t - step not in pieces or t - 2 * step not in pieces:
                break
            expected = 2 * pieces[t - step].centre - pieces[t - 2 * step].centre
            free = changed[t] & ~covered(others, t, changed.shape[1:])
            piece = _seen_at(expected, replace(track, pieces=pieces), frames[t], free)
            if piece is None:
                break
            pieces[t] = piece
        pieces = parts | pieces
    return replace(track, pieces=pieces)


def _seen_at(expected: np.ndarray, track: Track, frame: np.ndarray, free: np.ndarray) -> Piece | None:
    """The body's piece about an expected centre (2,) px of a frame; None where it is not seen there.

    free: (H, W) bool, where the frame differs from the background and shows no other body.
    """
    height, width = frame.shape[:2]
    radius, area = track.typical_radius, track.typical_area
    y, x = np.mgrid[:height, :width] + 0.5
    near = np.hypot(x - expected[0], y - expected[1]) < REACH * max(radius, 2.0)
    rows, cols = np.nonzero(near & free)
    apart = np.abs(frame[rows, cols, None] / 255 - track.palette).max(-1).min(-1, initial=np.inf)
    alike = np.zeros((height, width), np.uint8)
    alike[rows[apart < NEAR_COLOUR], cols[apart < NEAR_COLOUR]] = 1
    count, labels, stats, centres = cv2.connectedComponentsWithStats(alike, connectivity=8)
    if count < 2:
        return None
    k = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    own = labels == k
    centre = centres[k] + 0.5
    colour = frame[own].mean(0) / 255
    cut = own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any()
    least = 0.0 if cut else LEAST_AREA * area
    if not least < own.sum() < MOST_AREA * area:
        return None
    if not cut and np.linalg.norm(centre - expected) > CLOSE * max(radius, 2.0):
        return None
    return Piece(np.flatnonzero(own), centre, radius, colour)
