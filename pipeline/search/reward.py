"""The kernel that compares the masks and exact flow of candidates with those of the target, in parallel.

From its counts, reward = IoU - EPE over the whole frame (px of 480x320 per frame interval); docs/formats.md, "Metrics",
has the definitions. For Gauss-Newton it also pools each object's mask and flow (`pooled_residuals`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import prange

from pipeline.clips.overlap import Counts
from pipeline.compiled import parallel_kernel
from pipeline.search.pooled_residuals import pool_frame
from pipeline.search.target import Target
from pipeline.vision.rendering.exact_flow import exact_flow_frame
from pipeline.vision.rendering.rasteriser import draw_fixed, fill_background, rasterise_frame


@dataclass(frozen=True)
class Measured:
    """The comparison of B candidates with a target of F frames and M instances.

    Attributes:
        shared: (B, F, N, M) pixels of both object and instance.
        predicted: (B, F, N) pixels of each object.
        true: (B, F, M) pixels of each instance.
        foreground: (B, F, 2) pixels of the foreground of both, and of either.
        epe_frame: (B,) mean end-point error over all pixels, px of the target's size.
        epe: (B,) mean end-point error over the foreground of either, px of the target's size.
        pooled: (B, F, N, 3, h, w), or empty.
    """

    shared: np.ndarray
    predicted: np.ndarray
    true: np.ndarray
    foreground: np.ndarray
    epe_frame: np.ndarray
    epe: np.ndarray
    pooled: np.ndarray

    @property
    def all_counts(self) -> Counts:
        return Counts(self.shared, self.predicted, self.true, self.foreground)

    def counts(self, candidate: int) -> Counts:
        b = candidate
        return Counts(self.shared[b], self.predicted[b], self.true[b], self.foreground[b])


@dataclass(frozen=True)
class Totals:
    """Sums over the target.

    Attributes:
        area: (F, M) pixels of each instance.
        foreground: (F,) pixels of all instances.
        speed: (F, H, W) length of the flow, px.
        speed_frame: (F,) its sum over all pixels.
        speed_foreground: (F,) its sum over the foreground.
    """

    area: np.ndarray
    foreground: np.ndarray
    speed: np.ndarray
    speed_frame: np.ndarray
    speed_foreground: np.ndarray

    @classmethod
    def of(cls, target: Target) -> Totals:
        area = (
            np.stack([(target.masks == j + 1).sum((1, 2)) for j in range(target.instances)], 1)
            if target.instances
            else np.zeros((len(target.masks), 0), np.int64)
        )
        front = target.masks > 0
        speed = np.linalg.norm(target.flow, axis=-1)
        return cls(area, front.sum((1, 2)), speed, speed.sum((1, 2), float), (speed * front).sum((1, 2), dtype=float))


@parallel_kernel
def measure_kernel(
    kinds: np.ndarray,
    half_size: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov: np.ndarray,
    ground: np.ndarray,
    fixed_kinds: np.ndarray,
    fixed_half_size: np.ndarray,
    fixed_position: np.ndarray,
    fixed_quaternion: np.ndarray,
    target_masks: np.ndarray,
    target_flow: np.ndarray,
    area: np.ndarray,
    area_foreground: np.ndarray,
    speed: np.ndarray,
    speed_frame: np.ndarray,
    speed_foreground: np.ndarray,
    cell: int,
    shared: np.ndarray,
    predicted: np.ndarray,
    true: np.ndarray,
    foreground: np.ndarray,
    epe_frame: np.ndarray,
    epe: np.ndarray,
    pooled: np.ndarray,
) -> None:
    """Fill the fields of `Measured`, which must be zero.

    Only the bounding rectangle of a candidate's objects is visited; outside it the sums of the target are used.

    Args:
        kinds, half_size, camera_position, camera_rotation, fov, ground: As in `SceneBatch`.
        fixed_kinds, fixed_half_size, fixed_position, fixed_quaternion: Likewise.
        position: (B, F, 2, N, 3) m, in each frame and in the frame to which its flow leads.
        quaternion: (B, F, 2, N, 4), likewise.
        target_masks, target_flow: As in `Target`.
        area, area_foreground, speed, speed_frame, speed_foreground: As in `Totals`.
        cell: Spacing of the nodes of `pooled`, px.
        shared, predicted, true, foreground, epe_frame, epe, pooled: Output; `pooled` may be empty.
    """
    frames, height, width = target_masks.shape
    for b in prange(position.shape[0]):
        background = np.empty((height, width), np.float32)
        mask = np.empty((height, width), np.uint8)
        depth = np.empty((height, width), np.float32)
        flow = np.empty((height, width, 2), np.float32)
        fill_background(camera_position[b], camera_rotation[b], fov[b], ground[b], background)
        draw_fixed(
            fixed_kinds,
            fixed_half_size[b],
            fixed_position[b],
            fixed_quaternion[b],
            camera_position[b],
            camera_rotation[b],
            fov[b],
            mask,
            background,
        )
        total, front, pixels = 0.0, 0.0, 0
        for k in range(frames):
            within = rasterise_frame(
                kinds,
                half_size[b],
                position[b, k, 0],
                quaternion[b, k, 0],
                camera_position[b],
                camera_rotation[b],
                fov[b],
                background,
                mask,
                depth,
            )
            exact_flow_frame(
                position[b, k, 0],
                quaternion[b, k, 0],
                position[b, k, 1],
                quaternion[b, k, 1],
                camera_position[b],
                camera_rotation[b],
                fov[b],
                mask,
                depth,
                within,
                flow,
            )
            true[b, k] = area[k]
            total += speed_frame[k]
            front += speed_foreground[k]
            both, either = 0, area_foreground[k]
            top, bottom, left, right = within
            for row in range(top, bottom):
                for col in range(left, right):
                    i = mask[row, col]
                    if i == 0:
                        continue
                    j = target_masks[k, row, col]
                    u = flow[row, col, 0] - target_flow[k, row, col, 0]
                    v = flow[row, col, 1] - target_flow[k, row, col, 1]
                    length = np.sqrt(u * u + v * v)
                    total += length - speed[k, row, col]
                    predicted[b, k, i - 1] += 1
                    if j:
                        shared[b, k, i - 1, j - 1] += 1
                        both += 1
                        front += length - speed[k, row, col]
                    else:
                        either += 1
                        front += length
            foreground[b, k, 0], foreground[b, k, 1] = both, either
            pixels += either
            if pooled.size:
                pool_frame(mask, flow, within, cell, pooled[b, k])
        epe_frame[b] = total / (frames * height * width)
        epe[b] = front / max(pixels, 1)
