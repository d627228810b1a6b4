"""Two bodies that look alike and hit each other, whose numbers masks exchange in that frame.

The struck body starts and the other one stops, so that a tracker that extrapolates velocities takes one for the other.
Solid bodies that meet in a plane cannot pass through each other: where two tracks do so in one frame interval, and
neither hides the other, the numbers were exchanged.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack, image_tracks

NEAR = 1.6  # sums of radii: distance of two bodies that have just met, or are about to
WHOLE = 0.8  # share of its area that a body shows at least, if the other does not hide it
ALIKE = 20.0  # CIELAB units between the mean colours
COLOUR_FRAMES = 8


def without_exchanges(masks: np.ndarray, frames: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Masks in which bodies keep their numbers where they hit each other.

    Args:
        masks: (T, H, W) ids from 1.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s.
    """
    out = masks
    tracks = image_tracks(masks, times)
    for one, other in itertools.combinations(tracks, 2):
        for k in passages(one, other):
            if alike(masks, frames, one, other):
                out = out.copy() if out is masks else out
                a, b = out[k:] == one.body, out[k:] == other.body
                out[k:][a], out[k:][b] = other.body, one.body
    return out


def passages(one: ImageTrack, other: ImageTrack) -> list[int]:
    """The frames before which two tracks pass through each other, with neither hiding the other."""
    frames, i, j = np.intersect1d(one.frames, other.frames, return_indices=True)
    apart = other.centre[j] - one.centre[i]
    near = np.linalg.norm(apart, axis=1) < NEAR * (one.radius + other.radius)
    whole = np.minimum(one.area[i] / np.median(one.area), other.area[j] / np.median(other.area)) > WHOLE
    use = near & whole
    turned = (apart[:-1] * apart[1:]).sum(1) < 0
    return [int(f) for f in frames[1:][turned & use[:-1] & use[1:] & (np.diff(frames) == 1)]]


def alike(masks: np.ndarray, frames: np.ndarray, one: ImageTrack, other: ImageTrack) -> bool:
    """Whether two bodies of masks (T, H, W) have about one colour in frames (T, H, W, 3) uint8 RGB."""
    colours = [_colour(masks, frames, t) for t in (one, other)]
    return float(np.linalg.norm(colours[0] - colours[1])) < ALIKE


def _colour(masks: np.ndarray, frames: np.ndarray, track: ImageTrack) -> np.ndarray:
    """(3,) CIELAB, the median over some frames of the mean colour of a body."""
    some = track.frames[np.linspace(0, len(track) - 1, min(len(track), COLOUR_FRAMES)).round().astype(int)]
    means = [frames[k][masks[k] == track.body].mean(0) for k in some]
    colour = np.median(means, axis=0).astype(np.float32) / 255
    return np.asarray(cv2.cvtColor(colour[None, None], cv2.COLOR_RGB2LAB)[0, 0], float)
