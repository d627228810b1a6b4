"""A rigid body that hardly turns, followed by template matching where its mask is missing or shows a part only.

The template is the median of the frames that show the body whole. It is matched near where the body was in the frame
before, or after.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.motion.completed_body import evenly_spaced, grey_levels, shown_whole
from pipeline.motion.image_track import image_tracks

LEAST_WHOLE = 5  # frames that show the body whole
TEMPLATE_FRAMES = 9  # of which the template is the median
RIM_PX = 3  # around the body, which belong to the template
REACH, LEAST_REACH_PX = 0.5, 8  # lengths of the body, px: how far from its last place it is matched
LEAST_CORRELATION = 0.85  # with the template


@dataclass(frozen=True)
class Template:
    """A body and its rim.

    Attributes:
        picture: (h, w) float32, grey levels.
        region: (h, w) float32, 1 on the body and its rim, else 0.
        outline: (h, w) uint8, 1 on the body, else 0.
    """

    picture: np.ndarray
    region: np.ndarray
    outline: np.ndarray

    def match(self, frame: np.ndarray, corner: np.ndarray, reach: int) -> tuple[np.ndarray, float]:
        """Where a frame is most like the template.

        Args:
            frame: (H, W) float32, grey levels.
            corner: (2,) px, of the template's upper left corner, about which it is matched.
            reach: px.

        Returns:
            (2,) px, of the upper left corner, and the correlation there, at most 1.
        """
        low = corner - reach
        height, width = np.array(self.outline.shape) + 2 * reach
        window = _shifted(frame, -low, (height, width))
        correlation = cv2.matchTemplate(window, self.picture, cv2.TM_CCOEFF_NORMED, mask=self.region)
        correlation = np.where(np.isfinite(correlation), correlation, 0)
        y, x = np.unravel_index(int(correlation.argmax()), correlation.shape)
        return low + np.array([x, y]), float(correlation[y, x])


def followed(masks: np.ndarray, frames: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A body's masks, and its outline where its template is found in other frames.

    Args:
        masks: (T, H, W) bool.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s.

    Returns:
        (T, H, W) bool.
    """
    tracks = image_tracks(masks, times)
    whole = tracks[0].frames[shown_whole(tracks[0])] if tracks else np.zeros(0, int)
    if len(whole) < LEAST_WHOLE or len(whole) == len(masks):
        return masks
    size = 2 * RIM_PX + np.max([np.ptp(np.argwhere(masks[k]), axis=0) + 1 for k in whole], axis=0)
    corners = {int(k): _middle(masks[k]) - size[::-1] // 2 for k in whole}
    shown = whole[evenly_spaced(len(whole), TEMPLATE_FRAMES)]
    template = _template([(masks[k], grey_levels(frames[k]), corners[k]) for k in shown], size)
    reach = max(LEAST_REACH_PX, round(REACH * max(size)))
    for way, step in ((range(1, len(masks)), 1), (range(len(masks) - 2, -1, -1), -1)):
        for k in way:
            if k not in corners and k - step in corners:
                place, correlation = template.match(grey_levels(frames[k]), corners[k - step], reach)
                if correlation > LEAST_CORRELATION:
                    corners[k] = place
    out = masks.copy()
    for k in corners.keys() - set(whole.tolist()):
        out[k] = _shifted(template.outline, corners[k], masks.shape[1:]) > 0
    return out


def _template(shown: list[tuple[np.ndarray, np.ndarray, np.ndarray]], size: np.ndarray) -> Template:
    """The template of a body by masks and grey frames (H, W each) and corners, of size (2,) rows, columns."""
    pictures = [_shifted(frame, -corner, size) for _, frame, corner in shown]
    outlines = [_shifted(mask.astype(np.uint8), -corner, size) for mask, _, corner in shown]
    outline = (np.mean(outlines, 0) > 0.5).astype(np.uint8)
    region = cv2.dilate(outline, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)).astype(np.float32)
    return Template(np.median(pictures, 0).astype(np.float32), region, outline)


def _middle(mask: np.ndarray) -> np.ndarray:
    """(2,) px, x and y: the centroid of a mask (H, W), rounded."""
    return np.round(np.argwhere(mask).mean(0)[::-1]).astype(int)


def _shifted(picture: np.ndarray, by: np.ndarray, shape: Iterable[int]) -> np.ndarray:
    """A picture moved by (2,) px, cut or filled with 0 to a shape (rows, columns)."""
    height, width = (int(n) for n in shape)
    moved = np.array([[1, 0, by[0]], [0, 1, by[1]]], np.float64)
    return np.asarray(cv2.warpAffine(picture, moved, (width, height), flags=cv2.INTER_NEAREST))
