"""A rigid body of which a mask shows only a part, in frames before and after which the whole is found.

The whole is put so that the part is one of its pieces, where all of it differs from the background.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from pipeline.motion.image_track import MAD, ImageTrack, image_tracks

BACKGROUND_FRAMES = 40
LEAST_CHANGED = 0.6  # of the completed body must differ from the background
LEAST_CONTRAST = 6.0  # grey levels, or 4 standard deviations of the noise
LEAST_PART = 0.6  # of a body's length: what shows less is completed
LONGEST = 95  # percentile of the lengths, that is the body's: masks may gain parts, too
NEAREST = 5  # whole frames that may complete a part
SAME_PART = 0.3  # most difference of a part's area, as a share, in the frame that completes it
SAME_SHAPE = 0.15  # most change of length and of the root of the area, as a share, in frames that show a body whole


def completed(pieces: np.ndarray, frames: np.ndarray, hulls: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: a rigid body's mask, completed where only a small part of it is found.

    Args:
        pieces: (T, H, W) ids of its pieces, else 0.
        frames: (T, H, W, 3) uint8 RGB.
        hulls: (T, H, W) bool, its convex hull.
        times: (T,) s.
    """
    out = hulls.copy()
    tracks = image_tracks(hulls, times)
    if not tracks:
        return out
    lengths = tracks[0].axes[:, 0] / np.percentile(tracks[0].axes[:, 0], LONGEST)
    whole, parts = tracks[0].frames[np.abs(lengths - 1) < SAME_SHAPE], tracks[0].frames[lengths < LEAST_PART]
    if not len(parts):
        return out
    for k, differs in zip(parts, differing(frames, hulls, parts)[0], strict=True):
        out[k], best, size = False, LEAST_CHANGED, (hulls.shape[2], hulls.shape[1])
        for j in whole[np.argsort(np.abs(whole - k), kind="stable")][:NEAREST]:
            for shift in _shifts(pieces[k], pieces[j]):
                moved = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float64)
                placed = cv2.warpAffine(hulls[j].astype(np.uint8), moved, size, flags=cv2.INTER_NEAREST) > 0
                share = float(differs[placed].mean()) if placed.any() else 0.0
                if share > best:
                    out[k], best = placed, share
    return out


def shown_whole(track: ImageTrack) -> np.ndarray:
    """(T,) bool: where a body is about as long and as large as it is at most."""
    whole = np.ones(len(track), bool)
    for size in (track.axes[:, 0], np.sqrt(track.area)):
        whole &= np.abs(size / np.percentile(size, LONGEST) - 1) < SAME_SHAPE
    return whole


def grey_levels(frame: np.ndarray) -> np.ndarray:
    """(H, W) float32 of a frame (H, W, 3) uint8 RGB."""
    return cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)


def evenly_spaced(count: int, most: int) -> np.ndarray:
    """At most so many of the indices of `count` things."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)


def _shifts(part: np.ndarray, whole: np.ndarray) -> list[np.ndarray]:
    """(2,) px each, by which a piece of one frame (H, W) is away from one of about its area in another frame."""
    now, then = (
        [np.stack(np.nonzero(frame == piece)[::-1], 1) for piece in np.unique(frame[frame > 0])]
        for frame in (part, whole)
    )
    return [
        one.mean(0) - other.mean(0)
        for one, other in itertools.product(now, then)
        if abs(len(one) / len(other) - 1) < SAME_PART
    ]


def differing(frames: np.ndarray, hulls: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where some frames differ from what is behind a body.

    Args:
        frames: (T, H, W, 3) uint8 RGB.
        hulls: (T, H, W) bool, that hide the background.
        which: (N,) indices of the frames.

    Returns:
        (N, H, W) bool, and where the background is known, (H, W) bool.
    """
    some = evenly_spaced(len(frames), BACKGROUND_FRAMES)
    grey = {k: grey_levels(frames[k]) for k in {*some, *which}}
    shown = np.stack([grey[k] for k in some])
    hidden = hulls[some]
    background = np.median(shown, axis=0)
    behind = hidden.any(0)  # the rest needs no mask
    background[behind] = np.ma.median(np.ma.array(shown[:, behind], mask=hidden[:, behind]), axis=0).filled(np.nan)
    noise = MAD * float(np.median(np.abs(np.diff(shown, axis=0)))) / np.sqrt(2)
    least = max(LEAST_CONTRAST, 4 * noise)
    return np.stack([np.abs(grey[k] - background) > least for k in which]), ~hidden.all(0)
