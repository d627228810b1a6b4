"""Frames in which a body rests, or nearly, and the network does not see it: it looks there as when it was last seen.

A body that rests for most of a clip is in the median picture itself, and then little tells that it ever moved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.segmentation.grouping import Piece, Track

ALIKE = 14  # of 255: most change of a pixel's channels where the same thing is seen
LEAST_ALIKE = 0.85  # of a body's pixels
SLOW = 2  # px a frame: what moves faster is not looked for
LEAST_REST = 3  # frames in a row that must show the body
SHIFTS = sorted(
    ((dy, dx) for dy in range(-SLOW, SLOW + 1) for dx in range(-SLOW, SLOW + 1)), key=lambda s: s[0] ** 2 + s[1] ** 2
)


def seen_again(piece: Piece, frame: np.ndarray, next_frame: np.ndarray) -> Piece | None:
    """A piece of one frame (H, W, 3) uint8 where it is in the next, at most SLOW px away; None where it is not."""
    height, width = frame.shape[:2]
    rows, cols = np.divmod(piece.pixels, width)
    colours = frame[rows, cols].astype(np.int16)
    best, best_change, best_shift = None, np.inf, (0, 0)
    for dy, dx in SHIFTS:
        r, c = rows + dy, cols + dx
        inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
        if inside.sum() < 0.8 * len(rows):
            continue
        change = np.abs(colours[inside] - next_frame[r[inside], c[inside]].astype(np.int16)).max(-1)
        mean = change.mean() + 0.3 * np.hypot(dy, dx)
        if mean < best_change and (change < ALIKE).mean() >= LEAST_ALIKE:
            best, best_change, best_shift = (r[inside] * width + c[inside]), mean, (dy, dx)
    if best is None:
        return None
    return Piece(best, piece.centre + np.array(best_shift[::-1]), piece.radius, piece.colour)


def with_rests(track: Track, frames: np.ndarray) -> Track:
    """The track with the frames before its beginning and after its end in which its body (nearly) rests.

    frames: (T, H, W, 3) uint8. At least LEAST_REST frames in a row, or all up to the clip's end, must show it.
    """
    pieces = dict(track.pieces)
    for end, step in ((max(pieces), 1), (min(pieces), -1)):
        found: dict[int, Piece] = {}
        piece: Piece | None = pieces[end]
        t = end + step
        while 0 <= t < len(frames) and piece is not None:
            piece = seen_again(piece, frames[t - step], frames[t])
            if piece is not None:
                found[t] = piece
                t += step
        if len(found) >= LEAST_REST or not 0 <= t < len(frames):
            pieces.update(found)
    return replace(track, pieces=pieces)
