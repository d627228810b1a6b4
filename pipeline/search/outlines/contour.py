"""The outline of an instance in each frame, as points between pixels inside and outside of its mask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

POINTS = 64  # most points of one frame
LEAST_PIXELS = 12  # smaller masks have no outline
_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))


@dataclass(frozen=True)
class Contour:
    """The outline of one instance in K frames.

    Attributes:
        frames: (K,) indices of the clip's frames in which it is seen, increasing.
        points: (K, POINTS, 2) px from the centre of the image, right and up, by angle about the mask's centroid.
        free: (K, POINTS) whether the point belongs to the body's own outline. Others are at the border of the picture
            or at another instance, which may hide the body: there the body reaches at least to the point.
        count: (K,) number of points.
        area: (K,) px.
    """

    frames: np.ndarray
    points: np.ndarray
    free: np.ndarray
    count: np.ndarray
    area: np.ndarray


def instance_contour(masks: np.ndarray, instance: int) -> Contour:
    """The outline of an instance, counted from 0, in masks (F, H, W), where 0 is the background."""
    frames, points, free, counts, areas = [], [], [], [], []
    for k, mask in enumerate(masks):
        own = mask == instance + 1
        area = int(np.count_nonzero(own))
        if area < LEAST_PIXELS:
            continue
        place, alone = frame_contour(mask, own)
        frames.append(k)
        areas.append(area)
        counts.append(len(place))
        padding = POINTS - len(place)
        points.append(np.pad(place, ((0, padding), (0, 0))))
        free.append(np.pad(alone, (0, padding)))
    return Contour(
        np.array(frames, np.int64),
        np.array(points, float).reshape(-1, POINTS, 2),
        np.array(free, bool).reshape(-1, POINTS),
        np.array(counts, np.int64),
        np.array(areas, np.int64),
    )


def frame_contour(mask: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 2) px from the centre of the image, and (P,) whether they are free; at most `POINTS` of them.

    Args:
        mask: (H, W), 0 for the background.
        own: (H, W) bool, the pixels of the instance.
    """
    height, width = mask.shape
    rows, columns = np.nonzero(own)
    top, left = rows.min(), columns.min()
    around = np.full((rows.max() - top + 3, columns.max() - left + 3), -1)  # -1 beyond the border of the picture
    inside = (slice(max(top - 1, 0), rows.max() + 2), slice(max(left - 1, 0), columns.max() + 2))
    part = mask[inside].astype(int)
    row0, column0 = inside[0].start - top + 1, inside[1].start - left + 1
    around[row0 : row0 + part.shape[0], column0 : column0 + part.shape[1]] = part
    rows, columns = rows - top + 1, columns - left + 1
    self_id = around[rows[0], columns[0]]
    found, alone = [], []
    for down, right in _STEPS:
        beyond = around[rows + down, columns + right]
        edge = beyond != self_id
        y = rows[edge] + 0.5 + 0.5 * down + top - 1
        x = columns[edge] + 0.5 + 0.5 * right + left - 1
        found.append(np.stack([x - width / 2, height / 2 - y], 1))
        alone.append(beyond[edge] == 0)
    place, own_edge = np.concatenate(found), np.concatenate(alone)
    middle = place.mean(0)
    order = np.argsort(np.arctan2(place[:, 1] - middle[1], place[:, 0] - middle[0]), kind="stable")
    if len(order) > POINTS:
        order = order[np.linspace(0, len(order) - 1, POINTS).round().astype(int)]
    return place[order], own_edge[order]
