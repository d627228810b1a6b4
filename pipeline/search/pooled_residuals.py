"""Smooth residuals between the masks and flow of candidates and those of the target, for Gauss-Newton.

The reward counts pixels, so it has no useful derivative. Here each object's mask, and its flow times its mask, are
pooled: they are distributed over the nodes of a grid by bilinear weights (hat functions), which change smoothly as the
object moves. Coarser grids are sums of finer ones. The difference from the pooled mask and flow of the instance, in
units of its area, is the residual. Its square is about 1 - IoU where the two overlap. Where they do not, area and
centroid, which follow from the same sums, give a direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from pipeline.search.target import REFERENCE_AREA, Target

CELLS = 24  # of the finest grid across the width of the picture
LEVELS = 3  # grids, each with half as many cells as the one before
#: An error of the flow by FLOW_PX (px of 480x320) plus FLOW_SHARE of the instance's mean flow counts as its whole area.
FLOW_PX, FLOW_SHARE = 12.0, 0.25
CENTROID_PX = 80.0  # px of 480x320: an error of the centroid that counts as the whole area
AREA_WEIGHT = 0.3  # residual for a factor e in area
LOST = 3.0  # residual of centroid and area where only one of object and instance is visible
INVALID_COST = 1e6


@dataclass(frozen=True)
class Residuals:
    """values: (B, N, R) float32 of each object, 0 where it has no instance. cost: (B, N), their sums of squares."""

    values: np.ndarray
    cost: np.ndarray

    def joined(self, more: np.ndarray) -> Residuals:
        """These residuals and others (B, N, R') of the same candidates."""
        cost = self.cost + np.einsum("bnr,bnr->bn", more, more)
        return Residuals(np.concatenate([self.values, more], 2), np.where(self.cost >= INVALID_COST, self.cost, cost))


@kernel
def pool_frame(
    mask: np.ndarray, flow: np.ndarray, within: tuple[int, int, int, int], cell: int, out: np.ndarray
) -> None:
    """Pool the masks and flow of one frame with bilinear weights.

    Args:
        mask: (H, W), i + 1 for object i.
        flow: (H, W, 2) px.
        within: Rectangle outside which the mask is 0: first row, one past the last, first column, one past the last.
        cell: Spacing of the nodes, px; the first is at the corner of the picture.
        out: (N, 3, h, w), output: pooled mask and flow of each object.
    """
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


class PooledTarget:
    """The pooled masks and flow of a target, and the residuals of candidates against them."""

    def __init__(self, target: Target) -> None:
        self.cell = max(1, round(target.width / CELLS))
        nodes = [-(-n // self.cell) + 1 for n in (target.height, target.width)]
        self.shape = (3, *nodes)
        scale = (target.width * target.height / REFERENCE_AREA) ** 0.5
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
        if target.flow_error is not None:
            unit *= target.flow_error
        self._units = np.stack([np.ones_like(unit), unit, unit], 1).astype(np.float32)  # (M, 3)
        self._centroid_px = CENTROID_PX * scale
        self._centroids = self._place(self._target[:, :, 0], areas)
        self._areas = areas
        self._halvings = [_halvings(n) for n in nodes]

    def _place(self, pooled: np.ndarray, areas: np.ndarray) -> np.ndarray:
        """Centroids (..., 2), px. They are exact because bilinear weights reproduce positions."""
        rows, columns = (np.arange(n, dtype=np.float32) * self.cell for n in pooled.shape[-2:])
        sums = np.stack([pooled.sum(-2) @ columns, pooled.sum(-1) @ rows], -1)
        return sums / np.maximum(areas, 1e-9)[..., None]

    def residuals(self, pooled: np.ndarray, pairs: np.ndarray, valid: np.ndarray) -> Residuals:
        """Residuals of candidates, with equal weights for all frames.

        Args:
            pooled: (B, F, N, 3, h, w), from `pool_frame`.
            pairs: (P, 2) objects and instances.
            valid: (B,); others get `INVALID_COST`.
        """
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


def _halvings(nodes: int) -> list[np.ndarray]:
    """Matrices, level by level, that sum the weights of a grid of `nodes` nodes to those of half as many cells."""
    out = []
    for _ in range(LEVELS - 1):
        coarse = nodes // 2 + 1
        matrix = np.zeros((coarse, nodes), np.float32)
        for k in range(coarse):
            for offset, weight in ((-1, 0.5), (0, 1.0), (1, 0.5)):
                if 0 <= 2 * k + offset < nodes:
                    matrix[k, 2 * k + offset] = weight
        out.append(matrix)
        nodes = coarse
    return out
