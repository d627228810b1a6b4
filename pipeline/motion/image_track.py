"""The track of one body in the picture: where its outline is in each filmed frame, and how large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_PIXELS = 4
MAD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
LEAST_SIGMA = 0.02  # px
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
        whole: (T,) bool: the mask does not touch the border of the picture.
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
    rows = []
    for k, mask in enumerate(own):
        y, x = np.nonzero(mask)
        if len(x) < LEAST_PIXELS:
            continue
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


def centre_sigma(centre: np.ndarray) -> float:
    """Standard deviation, px, of each coordinate of centres (T, 2), from their third differences; robust to impacts.

    Too few centres: half a pixel.
    """
    if len(centre) < 6:
        return 0.5
    third = np.diff(centre, 3, axis=0) / _THIRD_DIFFERENCE
    return max(float(MAD * np.median(np.abs(third))), LEAST_SIGMA)
