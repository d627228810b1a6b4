"""The track of one body in the picture: where its outline is in each filmed frame, and how large."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.optimize import least_squares

LEAST_PIXELS = 4  # of a body, for it to be seen
LEAST_CENTRES = 6  # from which their error can be estimated
DISC = 1.25  # largest ratio of the axes of a disc
LEAST_SEEN = 0.35  # of a disc's area, from which its centre is found where the border of the picture cuts it
MAD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
LEAST_SIGMA = 0.02  # px
LONGEST = 95  # percentile of a body's lengths, that is its own: masks may gain parts, too
SAME_SHAPE = 0.15  # most change of length and of the root of the area, as a share, in frames that show a body whole
NEAR_FRAMES, SAME_SIZE = 5, 0.2  # frames before and after; most change of length, or of the root of the area, from them
_THIRD_DIFFERENCE = 20.0**0.5  # standard deviation of a third difference of white noise of standard deviation 1


@dataclass(frozen=True)
class ImageTrack:
    """One body in the frames that show it whole enough to be measured.

    Attributes:
        body: Its number in the masks, from 1.
        frames: (T,) indices of the masks' frames.
        times: (T,) s.
        centre: (T, 2) px, the centroid of the mask; pixel centres are at half integers.
        axes: (T, 2) px, half lengths of the ellipse that has the mask's second moments, the longer one first.
        angle: (T,) rad, of the longer axis, from the picture's x axis towards its y axis (clockwise on the screen).
        area: (T,) px².
        whole: (T,) bool: the centre can be trusted: the mask does not touch the border of the picture, or the body is a
            disc of which enough is seen to find its centre; and it is as long and as large as shortly before and after.
        sigma: px, standard deviation of each coordinate of a centre, from the centres themselves.
    """

    body: int
    frames: np.ndarray
    times: np.ndarray
    centre: np.ndarray
    axes: np.ndarray
    angle: np.ndarray
    area: np.ndarray
    whole: np.ndarray
    sigma: float

    def __len__(self) -> int:
        return len(self.times)

    @property
    def radius(self) -> float:
        """px: of the disc with the median area of the whole masks."""
        area = self.area[self.whole] if self.whole.any() else self.area
        return float(np.sqrt(np.median(area) / np.pi))

    def part(self, which: np.ndarray) -> ImageTrack:
        """The samples of an index or mask (T,)."""
        names = ("frames", "times", "centre", "axes", "angle", "area", "whole")
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def in_picture(self, scale: float, offset: np.ndarray) -> ImageTrack:
        """The track in a picture whose point is scale times that of this one plus offset (2,) px."""
        return replace(
            self,
            centre=scale * self.centre + offset,
            axes=scale * self.axes,
            area=scale**2 * self.area,
            sigma=scale * self.sigma,
        )


def image_tracks(masks: np.ndarray, times: np.ndarray) -> list[ImageTrack]:
    """The tracks of all bodies in masks (T, H, W) of ids from 1, at times (T,) s.

    A body that is seen in fewer than two frames has none.
    """
    return [
        track
        for body in range(1, int(masks.max(initial=0)) + 1)
        if (track := _track(body, masks == body, times)) is not None
    ]


def _track(body: int, own: np.ndarray, times: np.ndarray) -> ImageTrack | None:
    height, width = own.shape[1:]
    rows: list[tuple[float, ...]] = []
    for k, mask in enumerate(own):
        points = cv2.findNonZero(mask.astype(np.uint8))
        if points is None or len(points) < LEAST_PIXELS:
            continue
        x, y = points.reshape(-1, 2).T
        whole = x.min() > 0 and y.min() > 0 and x.max() < width - 1 and y.max() < height - 1
        spread = np.cov(np.stack([x, y])) + np.eye(2) / 12
        values, vectors = np.linalg.eigh(spread)
        long, short = 2 * np.sqrt(values[::-1])
        angle = np.arctan2(vectors[1, 1], vectors[0, 1])
        rows.append((k, x.mean() + 0.5, y.mean() + 0.5, long, short, angle, len(x), whole))
    if len(rows) < 2:
        return None
    table = np.array(rows, float)
    frames = table[:, 0].astype(int)
    table[~keeps_size(table[:, 3]) | ~keeps_size(np.sqrt(table[:, 6])), 7] = 0
    _complete_discs(table, own)
    return ImageTrack(
        body=body,
        frames=frames,
        times=np.asarray(times, float)[frames],
        centre=table[:, 1:3],
        axes=table[:, 3:5],
        angle=table[:, 5],
        area=table[:, 6],
        whole=table[:, 7] > 0,
        sigma=centre_sigma(table[:, 1:3]),
    )


def keeps_size(size: np.ndarray) -> np.ndarray:
    """(T,) bool: where sizes (T,) are about the median of those of the NEAR_FRAMES frames before and after."""
    near = [np.median(size[max(k - NEAR_FRAMES, 0) : k + NEAR_FRAMES + 1]) for k in range(len(size))]
    return np.asarray(np.abs(size / near - 1) < SAME_SIZE)


def shown_whole(track: ImageTrack) -> np.ndarray:
    """(T,) bool: where a body is about as long and as large as it is at most."""
    whole = np.ones(len(track), bool)
    for size in (track.axes[:, 0], np.sqrt(track.area)):
        whole &= np.abs(size / np.percentile(size, LONGEST) - 1) < SAME_SHAPE
    return whole


def centre_sigma(centre: np.ndarray) -> float:
    """Standard deviation, px, of each coordinate of centres (T, 2), from their third differences; robust to impacts.

    Too few centres: half a pixel.
    """
    if len(centre) < LEAST_CENTRES:
        return 0.5
    third = np.diff(centre, 3, axis=0) / _THIRD_DIFFERENCE
    return max(float(MAD * np.median(np.abs(third))), LEAST_SIGMA)


def _complete_discs(table: np.ndarray, own: np.ndarray) -> None:
    """Find the centres of a disc in the frames in which the picture's border cuts it; in place.

    table: (T, 8), the rows of a track: frame, centre, axes, angle, area, whole. own: (F, H, W) bool.
    """
    whole = table[:, 7] > 0
    if whole.sum() < 2 or np.median(table[whole, 3] / np.maximum(table[whole, 4], 1e-6)) > DISC:
        return
    area = float(np.median(table[whole, 6]))
    for k in np.flatnonzero(~whole & (table[:, 6] > LEAST_SEEN * area)):
        centre = cut_disc(own[int(table[k, 0])], float(np.sqrt(area / np.pi)))
        if centre is not None:
            table[k, 1:3], table[k, 7] = centre, 1


def cut_disc(mask: np.ndarray, radius: float) -> np.ndarray | None:
    """Centre (2,) px of a disc of a radius, px, that the border of the picture cuts in a mask (H, W) bool.

    None where too little of its own edge is seen.
    """
    height, width = mask.shape
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(contours, key=len)[:, 0].astype(float)
    inner = (edge > 0).all(1) & (edge[:, 0] < width - 1) & (edge[:, 1] < height - 1)
    edge = edge[inner] + 0.5
    if len(edge) < 6:
        return None

    def off(centre: np.ndarray) -> np.ndarray:
        return np.linalg.norm(edge - centre, axis=1) - (radius - 0.5)

    found = least_squares(off, edge.mean(0), loss="soft_l1")
    return np.asarray(found.x) if np.sqrt(np.mean(off(found.x) ** 2)) < 0.1 * radius + 0.5 else None
