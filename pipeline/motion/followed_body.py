"""A rigid body that hardly turns, followed by its look through the frames in which its mask is missing or only a part.

Its look is the median of the frames that show the body whole. It is searched for near where the body was in the frame
before, or after.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.motion.completed_body import LONGEST, SAME_SHAPE
from pipeline.motion.image_track import image_tracks

LEAST_WHOLE = 5  # frames that show the body whole
LOOK_FRAMES = 9  # of which the look is the median
RIM_PX = 3  # around the body, which belong to its look
REACH, LEAST_REACH_PX = 0.5, 8  # lengths of the body, px: how far from its last place it is looked for
ALIKE = 0.85  # least correlation with the look


@dataclass(frozen=True)
class Look:
    """How a body and its rim look.

    Attributes:
        picture: (h, w) float32, grey levels.
        near: (h, w) float32, 1 on the body and its rim, else 0.
        outline: (h, w) uint8, 1 on the body, else 0.
    """

    picture: np.ndarray
    near: np.ndarray
    outline: np.ndarray

    def found(self, frame: np.ndarray, corner: np.ndarray, reach: int) -> tuple[np.ndarray, float]:
        """Where a frame is most like it.

        Args:
            frame: (H, W) float32, grey levels.
            corner: (2,) px, of the look's upper left corner, about which it is searched for.
            reach: px.

        Returns:
            (2,) px, of the upper left corner, and the correlation there, at most 1.
        """
        low = corner - reach
        height, width = np.array(self.outline.shape) + 2 * reach
        window = _shifted(frame, -low, (height, width))
        alike = cv2.matchTemplate(window, self.picture, cv2.TM_CCOEFF_NORMED, mask=self.near)
        alike = np.where(np.isfinite(alike), alike, 0)
        y, x = np.unravel_index(int(alike.argmax()), alike.shape)
        return low + np.array([x, y]), float(alike[y, x])


def followed(masks: np.ndarray, frames: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A body's masks, and its outline where its look is found in other frames.

    Args:
        masks: (T, H, W) bool.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s.

    Returns:
        (T, H, W) bool.
    """
    whole = whole_frames(masks, times)
    if len(whole) < LEAST_WHOLE or len(whole) == len(masks):
        return masks
    size = 2 * RIM_PX + np.max([np.ptp(np.argwhere(masks[k]), axis=0) + 1 for k in whole], axis=0)
    corners = {int(k): _middle(masks[k]) - size[::-1] // 2 for k in whole}
    look = _look([(masks[k], _grey(frames[k]), corners[k]) for k in _some(whole, LOOK_FRAMES)], size)
    reach = max(LEAST_REACH_PX, round(REACH * max(size)))
    ways: list[Iterable[int]] = [range(1, len(masks)), range(len(masks) - 2, -1, -1)]
    for way, step in zip(ways, (1, -1), strict=True):
        for k in way:
            if k not in corners and k - step in corners:
                place, alike = look.found(_grey(frames[k]), corners[k - step], reach)
                if alike > ALIKE:
                    corners[k] = place
    out = masks.copy()
    for k in corners.keys() - set(whole.tolist()):
        out[k] = _shifted(look.outline, corners[k], masks.shape[1:]) > 0
    return out


def whole_frames(masks: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(N,) indices of the frames in which masks (T, H, W) bool are as long and as large as they are at most."""
    tracks = image_tracks(masks, times)
    if not tracks:
        return np.zeros(0, int)
    alike = np.ones(len(tracks[0]), bool)
    for size in (tracks[0].axes[:, 0], np.sqrt(tracks[0].area)):
        alike &= np.abs(size / np.percentile(size, LONGEST) - 1) < SAME_SHAPE
    return tracks[0].frames[alike]


def _look(shown: list[tuple[np.ndarray, np.ndarray, np.ndarray]], size: np.ndarray) -> Look:
    """The look of a body by masks and grey frames (H, W each) and corners, of size (2,) rows, columns."""
    pictures = [_shifted(frame, -corner, size) for _, frame, corner in shown]
    outlines = [_shifted(mask.astype(np.uint8), -corner, size) for mask, _, corner in shown]
    outline = (np.mean(outlines, 0) > 0.5).astype(np.uint8)
    near = cv2.dilate(outline, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(np.float32)
    return Look(np.median(pictures, 0).astype(np.float32), near, outline)


def _grey(frame: np.ndarray) -> np.ndarray:
    """(H, W) float32, grey levels of a frame (H, W, 3) uint8 RGB."""
    return cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)


def _middle(mask: np.ndarray) -> np.ndarray:
    """(2,) px, x and y: the centroid of a mask (H, W), rounded."""
    return np.round(np.argwhere(mask).mean(0)[::-1]).astype(int)


def _some(values: np.ndarray, most: int) -> np.ndarray:
    """At most so many of some values, evenly spaced."""
    return np.asarray(values[np.linspace(0, len(values) - 1, min(len(values), most)).round().astype(int)])


def _shifted(picture: np.ndarray, by: np.ndarray, shape: Iterable[int]) -> np.ndarray:
    """A picture moved by (2,) px, cut or filled with 0 to a shape (rows, columns)."""
    height, width = (int(n) for n in shape)
    moved = np.array([[1, 0, by[0]], [0, 1, by[1]]], np.float64)
    return np.asarray(cv2.warpAffine(picture, moved, (width, height), flags=cv2.INTER_NEAREST))
