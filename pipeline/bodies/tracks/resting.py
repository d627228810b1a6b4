"""Frames in which a body rests, or nearly, and the network does not see it: it looks there as when it was last seen.

A body that rests for most of a clip is in the median picture itself, and then little tells that it ever moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.bodies.tracks.grouping import Piece, Track

ALIKE = 14  # of 255: most change of a pixel's channels where the same thing is seen
LEAST_ALIKE = 0.85  # of a body's pixels that no other body hides
LEAST_IN_VIEW = 0.3  # of a body's pixels: of a body that is hidden more it cannot be told whether it rests
SLOW = 2  # px a frame: what moves faster is not looked for
GHOST = 0.5  # share of a piece's pixels, where a body rests in the background, that differ from it in a ghost
LEAST_REST = 3  # frames in a row that must show the body
SHIFTS = sorted(
    ((dy, dx) for dy in range(-SLOW, SLOW + 1) for dx in range(-SLOW, SLOW + 1)), key=lambda s: s[0] ** 2 + s[1] ** 2
)


class Rest:
    """A body as it was last seen, followed from frame to frame.

    rows, cols: (M,) of its pixels, those that are hidden included. colours: (M, 3) as last seen.
    """

    def __init__(self, piece: Piece, frame: np.ndarray) -> None:
        self.centre, self.radius, self.colour = piece.centre, piece.radius, piece.colour
        self.rows, self.cols = np.divmod(piece.pixels, frame.shape[1])
        self.colours = frame[self.rows, self.cols].astype(np.int16)

    def advance(self, frame: np.ndarray, hidden: np.ndarray) -> Piece | None:
        """The body's piece of the next frame (H, W, 3) uint8, at most SLOW px away; None where it is not seen there.

        hidden: (H, W) bool, where other bodies are in that frame.
        """
        height, width = frame.shape[:2]
        best, least = None, np.inf
        for dy, dx in SHIFTS:
            r, c = self.rows + dy, self.cols + dx
            inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            if inside.sum() < 0.8 * len(r):
                continue
            seen = inside.copy()
            seen[inside] = ~hidden[r[inside], c[inside]]
            if seen.sum() < max(LEAST_IN_VIEW * len(r), 1):
                continue
            change = np.abs(self.colours[seen] - frame[r[seen], c[seen]].astype(np.int16)).max(-1)
            mean = change.mean() + 0.3 * np.hypot(dy, dx)
            if mean < least and (change < ALIKE).mean() >= LEAST_ALIKE:
                best, least = (r, c, inside, seen, np.array([dx, dy])), mean
        if best is None:
            return None
        r, c, inside, seen, shift = best
        self.colours[seen] = frame[r[seen], c[seen]]
        pixels = r[seen] * width + c[seen]
        self.rows, self.cols, self.colours = r[inside], c[inside], self.colours[inside]
        self.centre = self.centre + shift
        return Piece(pixels, self.centre, self.radius, self.colour)


def resting(tracks: Sequence[Track], frames: np.ndarray) -> list[Track]:
    """The tracks of a clip's bodies, each as of `with_rests` beside all others."""
    return [with_rests(k, frames, [other for other in tracks if other is not k]) for k in tracks]


def without_ghosts(track: Track, frames: np.ndarray, background: np.ndarray) -> Track:
    """The track without the frames in which it is a ghost.

    A body that rests for most of a clip is in the background. Before it comes, its place differs from the background
    because the body is not there yet.

    Args:
        track: As it was followed.
        frames: (T, H, W, 3) uint8.
        background: (H, W, 3) uint8, in which bodies that rest for long may be seen.
    """
    flat = background.reshape(-1, 3).astype(np.int16)
    at_rest, change = set(), {}
    for t, piece in track.pieces.items():
        change[t] = np.abs(frames[t].reshape(-1, 3)[piece.pixels] - flat[piece.pixels]).max(-1) >= ALIKE
        if change[t].mean() < GHOST:
            at_rest.add(t)
    if not at_rest:
        return track
    place = np.unique(np.concatenate([track.pieces[t].pixels for t in at_rest]))
    pieces = {
        t: piece
        for t, piece in track.pieces.items()
        if t in at_rest or (change[t] & np.isin(piece.pixels, place)).mean() < GHOST
    }
    return replace(track, pieces=pieces)


def with_rests(track: Track, frames: np.ndarray, others: Sequence[Track] = ()) -> Track:
    """The track with the frames, before, between and after its own, in which its body (nearly) rests.

    Args:
        track: As it was followed.
        frames: (T, H, W, 3) uint8.
        others: Tracks of other bodies, which may hide parts of it.

    Returns:
        The track. At least LEAST_REST frames in a row, or all up to the clip's end or its next piece, must show it.
    """
    pieces = dict(track.pieces)
    for start in sorted(track.pieces):
        for step in (1, -1):
            if start + step in pieces or not 0 <= start + step < len(frames):
                continue
            found: dict[int, Piece] = {}
            rest, t = Rest(track.pieces[start], frames[start]), start + step
            while 0 <= t < len(frames) and t not in track.pieces:
                piece = rest.advance(frames[t], covered(others, t, frames.shape[1:3]))
                if piece is None:
                    break
                found[t] = piece
                t += step
            if len(found) >= LEAST_REST or not 0 <= t < len(frames) or t in track.pieces:
                pieces = found | pieces
    return replace(track, pieces=pieces)


def covered(tracks: Sequence[Track], t: int, shape: tuple[int, int]) -> np.ndarray:
    """(H, W) bool: where the tracks are in frame t."""
    out = np.zeros(shape, bool)
    for track in tracks:
        if t in track.pieces:
            out.reshape(-1)[track.pieces[t].pixels] = True
    return out
