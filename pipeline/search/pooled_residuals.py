"""In which direction a candidate is wrong: each object's mask and flow, pooled, against the instance's.

Counting pixels tells how good a candidate is and nothing about where to go. So each object's mask, and its flow
times its mask, are spread over the nodes of a grid by tents (bilinear weights), which change smoothly as the object
moves; the tents of coarser grids are sums of finer ones. The difference to the instance's, in shares of its area, is
a residual for Gauss-Newton: its square is about 1 - IoU where the two overlap. Area and centroid, which follow from
the same sums, lead where they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from pipeline.search.target import REFERENCE_WIDTH, Target

CELLS = 24  # of the finest grid, over the width of the picture
LEVELS = 3  # grids, each of half as many cells as the one before
FLOW_PX, FLOW_SHARE = 12.0, 0.25  # px of 480x320, and share of the instance's mean flow, that count as its whole area
CENTROID_PX = 80.0  # px of 480x320 that count as its whole area
AREA_WEIGHT = 0.3  # of a factor e in area
LOST = 3.0  # residual of centroid and area where one of the two is not seen
INVALID_COST = 1e6


@dataclass(frozen=True)
class Residuals:
    """values (B, N, R) float32 of each object, 0 where it has no instance; cost (B, N): their squares' sum."""

    values: np.ndarray
    cost: np.ndarray


@kernel
def pool_frame(
    mask: np.ndarray, flow: np.ndarray, within: tuple[int, int, int, int], cell: int, out: np.ndarray
) -> None:
    """Fill out (N, 3, h, w) with the tent-weighted sums of mask (H, W), and of flow (H, W, 2) on it, in px, at nodes
    `cell` px apart, the first at the picture's corner. within: the rows and columns outside which the mask is 0."""
    out[:] = 0
    inverse = 1.0 / cell
    top, bottom, left, right = within
    for row in range(top, bottom):
        y = (row + 0.5) * inverse
        j = int(y)
        b = np.float32(y - j)
        for col in range(left, right):
            if mask[row, col] == 0:
                continue
            i = mask[row, col] - 1
            if i >= out.shape[0]:
                continue
            x = (col + 0.5) * inverse
            k = int(x)
            a = np.float32(x - k)
            one = np.float32(1)
            for channel in range(3):
                value = one if channel == 0 else flow[row, col, channel - 1]
                out[i, channel, j, k] += (one - b) * (one - a) * value
                out[i, channel, j, k + 1] += (one - b) * a * value
                out[i, channel, j + 1, k] += b * (one - a) * value
                out[i, channel, j + 1, k + 1] += b * a * value


class Pooling:
    """The target's pooled pictures, and the residuals of candidates against them."""

    def __init__(self, target: Target) -> None:
        self.cell = max(1, round(target.width / CELLS))
        nodes = [-(-n // self.cell) + 1 for n in (target.height, target.width)]
        self.shape = (3, *nodes)
        scale = target.width / REFERENCE_WIDTH
        frames = len(target.masks)
        self._target = np.zeros((frames, target.instances, *self.shape), np.float32)
        for k in range(frames):
            pool_frame(target.masks[k], target.flow[k], (0, target.height, 0, target.width), self.cell, self._target[k])
        areas = self._target[:, :, 0].sum((-2, -1))  # (F, M) px
        seen = np.maximum((areas > 0).sum(0), 1)
        self._area = np.maximum(areas.sum(0) / seen, 1.0)  # (M,)
        speed = np.zeros(target.instances)
        for j in range(target.instances):
            own = target.masks == j + 1
            speed[j] = np.linalg.norm(target.flow[own], axis=-1).mean() if own.any() else 0.0
        unit = FLOW_PX * scale + FLOW_SHARE * speed
        self._units = np.stack([np.ones_like(unit), unit, unit], 1).astype(np.float32)  # (M, 3)
        self._centroid_px = CENTROID_PX * scale
        self._centroids = self._place(self._target[:, :, 0], areas)
        self._areas = areas
        self._halvings = [_halving(n, LEVELS) for n in nodes]

    def _place(self, pooled: np.ndarray, areas: np.ndarray) -> np.ndarray:
        """Centroids (..., 2), px: tents add up to the position of each pixel."""
        rows, columns = (np.arange(n, dtype=np.float32) * self.cell for n in pooled.shape[-2:])
        sums = np.stack([pooled.sum(-2) @ columns, pooled.sum(-1) @ rows], -1)
        return sums / np.maximum(areas, 1e-9)[..., None]

    def residuals(self, pooled: np.ndarray, pairs: np.ndarray, valid: np.ndarray) -> Residuals:
        """Of candidates (B, F, N, 3, h, w), each frame a share of the whole."""
        count, frames, objects = pooled.shape[:3]
        share = 1 / np.sqrt(frames)
        columns = []
        for i, j in pairs:
            difference = (pooled[:, :, i] - self._target[:frames, j]) / self._units[j][:, None, None]
            parts = []
            cell = float(self.cell)
            for level in range(LEVELS):
                if level:
                    down, across = (h[level - 1] for h in self._halvings)
                    difference = down @ difference @ across.T
                    cell *= 2
                weight = share / np.sqrt(LEVELS * self._area[j]) / cell
                parts.append((difference * np.float32(weight)).reshape(count, -1))
            areas = pooled[:, :, i, 0].sum((-2, -1))
            both = (areas > 0) & (self._areas[:frames, j] > 0)
            either = (areas > 0) | (self._areas[:frames, j] > 0)
            place = (self._place(pooled[:, :, i, 0], areas) - self._centroids[:frames, j]) / self._centroid_px
            grown = AREA_WEIGHT * np.log(np.maximum(areas, 1) / np.maximum(self._areas[:frames, j], 1))
            extra = np.concatenate([place, grown[..., None]], -1)
            extra = np.where(both[..., None], extra, np.where(either, LOST, 0.0)[..., None] / np.sqrt(3))
            parts.append((share * extra).reshape(count, -1).astype(np.float32))
            columns.append(np.concatenate(parts, 1))
        size = columns[0].shape[1] if columns else 0
        values = np.zeros((count, objects, size), np.float32)
        for (i, _), column in zip(pairs, columns, strict=True):
            values[:, i] = column
        cost = np.einsum("bnr,bnr->bn", values, values)
        cost[~valid] = INVALID_COST
        return Residuals(values, cost)


def _halving(nodes: int, levels: int) -> list[np.ndarray]:
    """Matrices that sum the tents of a grid of so many nodes into those of half as many cells, level by level."""
    out = []
    for _ in range(levels - 1):
        coarse = nodes // 2 + 1
        matrix = np.zeros((coarse, nodes), np.float32)
        for k in range(coarse):
            for offset, weight in ((-1, 0.5), (0, 1.0), (1, 0.5)):
                if 0 <= 2 * k + offset < nodes:
                    matrix[k, 2 * k + offset] = weight
        out.append(matrix)
        nodes = coarse
    return out
