"""A noise model that gives exact flow the errors of RAFT, thousands of times faster than RAFT runs.

It has six kinds of error. Edges are blurred, because RAFT's grid is coarse. The flow of objects has a smooth error
that grows with its length. Parts of objects have the flow of the background (drop-outs). The flow of objects leaks
into the background beside them. Shadows move with their objects. The flow of the background fluctuates, in blotches
and in the cells of the coarse grid.

`raft_noise` draws the parameters of one clip. Their ranges were measured on 60 rendered clips (docs/decisions.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import cv2
import numpy as np

from pipeline.compiled import kernel
from pipeline.vision.flow.flow_picture import REFERENCE_WIDTH

NEAR_PX = 6.0  # px at 480 px of width: distance from an object within which its flow leaks


@dataclass(frozen=True)
class FlowNoise:
    """Parameters of the noise, none unless they are given. Lengths are px of 480x320; `noisy_flow` scales them.

    Attributes:
        edge_px: Sigma of the blur of edges.
        waver_px: Standard deviation of the smooth error on objects whose flow is zero.
        waver_share: Its increase with the length of the flow, as a share of that length.
        correlation_px: Sigma of the Gaussian that smooths this error.
        still_px: Standard deviation of the error on the background.
        dropout: Share of an object's pixels with the flow of the background.
        dropout_px: Sigma of the patches that drop out.
        leak: Share of the background near an object that takes the flow of the object.
        cell_px: Side of the cells in which part of the background's error is constant; 0: the error is smooth.
        cell_spread: Standard deviation of the logarithm of the cells' standard deviations.
        shadow: Flow of shadows, as a share of that of their objects.
    """

    edge_px: float = 0.0
    waver_px: float = 0.0
    waver_share: float = 0.0
    correlation_px: float = 0.0
    still_px: float = 0.0
    dropout: float = 0.0
    dropout_px: float = 0.0
    leak: float = 0.0
    cell_px: float = 0.0
    cell_spread: float = 0.0
    shadow: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            if not 0 <= getattr(self, f.name) < np.inf:
                raise ValueError(f"{f.name} must be zero or more, not {getattr(self, f.name)}")
        if max(self.dropout, self.leak, self.shadow) > 1:
            raise ValueError("dropout, leak and shadow are shares: at most 1")

    def scaled(self, strength: float) -> FlowNoise:
        """The noise with each error `strength` times as large or as frequent; correlation lengths do not change."""
        sizes = ("edge_px", "waver_px", "waver_share", "still_px")
        shares = {name: min(1.0, strength * getattr(self, name)) for name in ("dropout", "leak", "shadow")}
        return replace(self, **shares, **{name: strength * getattr(self, name) for name in sizes})


#: Range (low, high) of each parameter over clips, log-uniform: about the 10th to 90th percentile of 60 rendered clips
#: with the RAFT that ships. Clips differ so much because their light and textures differ.
RAFT_RANGES: dict[str, tuple[float, float]] = {
    "edge_px": (2.5, 9.0),
    "waver_px": (0.05, 1.4),
    "waver_share": (0.01, 0.25),
    "correlation_px": (9.0, 19.0),
    "still_px": (0.03, 0.5),
    "dropout": (0.005, 0.06),
    "dropout_px": (6.0, 20.0),
    "leak": (0.15, 0.6),
    "cell_spread": (0.3, 1.2),
}
CELL_PX = 16.0  # a cell of RAFT's grid: 8 px of 240x160
#: Sigma, px, and share of the variance of the components of the background's error, besides the cells. Its correlation
#: at 8, 16, 32, 64 and 128 px is 0.87, 0.67, 0.46, 0.24 and 0.08; that of RAFT's error is 0.84, 0.71, 0.49, 0.23 and
#: 0.09 (60 clips, more than 24 px from objects).
BLOTCHES = ((8.0, 0.3), (24.0, 0.38), (64.0, 0.22))
CELL_SHARE = 0.1
SHADOWS = 0.7  # share of clips whose shadows move


def raft_noise(rng: np.random.Generator) -> FlowNoise:
    """Random parameters of one clip, distributed as those of RAFT."""
    drawn = {name: float(np.exp(rng.uniform(*np.log(limits)))) for name, limits in RAFT_RANGES.items()}
    shadow = rng.uniform(0.2, 1.0) if rng.random() < SHADOWS else 0.0
    return FlowNoise(**drawn, cell_px=CELL_PX, shadow=shadow)


def add_raft_noise(rng: np.random.Generator, flow_px: np.ndarray, masks: np.ndarray, strength: float) -> np.ndarray:
    """`noisy_flow` with random parameters from `raft_noise`, `strength` times as strong."""
    return noisy_flow(rng, flow_px, masks, raft_noise(rng).scaled(strength))


def noisy_flow(rng: np.random.Generator, flow_px: np.ndarray, masks: np.ndarray, noise: FlowNoise) -> np.ndarray:
    """Exact flow with noise.

    Args:
        rng: Random generator.
        flow_px: (T, H, W, 2).
        masks: (T, H, W), 0 for the background.
        noise: Parameters.

    Returns:
        (T, H, W, 2) float32, px.
    """
    scale = flow_px.shape[2] / REFERENCE_WIDTH
    out = flow_px.astype(np.float32)
    shadow = shadow_to_object(rng, flow_px.shape[1:3]) if noise.shadow else None
    for flow, mask in zip(out, masks, strict=True):
        front = mask > 0
        if shadow is not None:
            _cast_shadows(flow, front, shadow, noise.shadow)
        disturb(rng, flow, front, noise, scale)
    return out


def shadow_to_object(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """A random affine map (2, 3) from pixels (x, y, 1) of shadows to pixels of the objects that cast them.

    shape: (height, width) px. Shadows are flattened and sheared images of the objects.
    """
    height, width = shape
    squash = rng.uniform(0.25, 0.7)
    fall = rng.uniform(0.02, 0.2) * height
    place = np.array(
        [[1, rng.uniform(-0.3, 0.3), rng.uniform(-0.12, 0.12) * width], [0, squash, (1 - squash) * height / 2 + fall]]
    )
    return cv2.invertAffineTransform(place)


def disturb(rng: np.random.Generator, flow: np.ndarray, foreground: np.ndarray, noise: FlowNoise, scale: float) -> None:
    """Add noise to the flow of one frame, in place.

    Args:
        rng: Random generator.
        flow: (H, W, 2) float32, px.
        foreground: (H, W) bool.
        noise: Parameters.
        scale: Width of the frame over 480 px.
    """
    still = still_noise(rng, flow.shape, noise, scale)
    still *= np.float32(scale * noise.still_px)
    if foreground.any():
        part = bounds(foreground | (flow[..., 0] != 0) | (flow[..., 1] != 0), scale * max(NEAR_PX, 3 * noise.edge_px))
        disturb_objects(rng, flow[part], foreground[part], still[part], noise, scale)
    flow += still


def bounds(where: np.ndarray, margin_px: float) -> tuple[slice, slice]:
    """Rows and columns of the bounding box of `where` (H, W) bool, extended by `margin_px` within the frame."""
    x, y, width, height = cv2.boundingRect(where.view(np.uint8))
    margin = math.ceil(margin_px)
    return slice(max(y - margin, 0), y + height + margin), slice(max(x - margin, 0), x + width + margin)


def disturb_objects(
    rng: np.random.Generator,
    flow: np.ndarray,
    foreground: np.ndarray,
    still: np.ndarray,
    noise: FlowNoise,
    scale: float,
) -> None:
    """Add the errors on and near objects in place; `still`, the background's error, becomes 0 there."""
    if noise.leak > 0:
        nearest = nearest_foreground(foreground, NEAR_PX * scale)
        field = smooth_noise(rng, foreground.shape, scale * max(noise.dropout_px, 1))
        _leak(flow, nearest, field, upper_quantile(field[nearest >= 0], noise.leak))
    if noise.dropout > 0:
        field = smooth_noise(rng, foreground.shape, scale * noise.dropout_px)
        drop_out(flow, foreground, field, upper_quantile(field[foreground], noise.dropout))
    if scale * noise.edge_px >= 0.1:
        flow[:] = cv2.GaussianBlur(flow, (0, 0), scale * noise.edge_px)
    waver = smooth_noise(rng, flow.shape, scale * noise.correlation_px)
    add_waver(flow, foreground, waver, still, scale, noise.waver_px, noise.waver_share)


def upper_quantile(values: np.ndarray, share: float) -> float:
    """The value above which a share of values (V,) lies; -inf where the share is 1."""
    rank = len(values) - round(share * len(values)) - 1
    return float(np.partition(values, rank)[rank]) if rank >= 0 else -np.inf


def still_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: FlowNoise, scale: float) -> np.ndarray:
    """The background's error (H, W, 2) in units of its standard deviation: smooth, or of cells and blotches."""
    cell = round(scale * noise.cell_px)
    if cell < 2:
        return smooth_noise(rng, shape, scale * noise.correlation_px)
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    cells = np.float32(CELL_SHARE**0.5) * rng.standard_normal((rows, columns, 2), dtype=np.float32)
    size = np.exp(np.float32(noise.cell_spread) * smooth_noise(rng, (rows, columns), 1.5))
    stride = grid_stride(scale * BLOTCHES[0][0])
    coarse = (-(-shape[0] // stride), -(-shape[1] // stride), 2)
    blotches = np.zeros(coarse, np.float32)
    for sigma, share in BLOTCHES:
        blotches += np.float32(share**0.5) * smooth_noise(rng, coarse, scale * sigma / stride)
    out = upsampled(blotches, stride, shape)
    _flicker(out, cells, size, cell)
    return out


def nearest_foreground(foreground: np.ndarray, distance_px: float) -> np.ndarray:
    """The nearest foreground pixel, as row * W + column, of each background pixel that has one within `distance_px`.

    foreground: (H, W) bool. Returns (H, W) int32, -1 elsewhere; of pixels at equal distance, the first.
    """
    disc, offsets = disc_within(distance_px)
    return _nearest(foreground, cv2.dilate(foreground.view(np.uint8), disc), offsets)


@lru_cache(maxsize=8)
def disc_within(distance_px: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc as a mask, and the offsets (K, 2), row and column, of its pixels from the centre, in order of distance.

    The offsets leave out the centre.
    """
    reach = int(distance_px)
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    away = np.hypot(*offsets.T)
    order = np.argsort(away, kind="stable")
    disc = (away <= distance_px).astype(np.uint8).reshape(2 * reach + 1, -1)
    return disc, offsets[order[1 : disc.sum()]]


def grid_stride(sigma: float) -> int:
    """Spacing, px, of the grid on which noise smoothed by `sigma` px is drawn."""
    return max(1, int(sigma / 1.5))


def smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Gaussian noise of unit standard deviation, smoothed by a Gaussian of `sigma` px over the first two axes.

    Where `sigma` is more than a few pixels, the noise is drawn on a coarser grid and interpolated.
    """
    stride = grid_stride(sigma)
    coarse = sigma / stride
    grid = (-(-shape[0] // stride), -(-shape[1] // stride), *shape[2:])
    # Uniform noise is drawn faster, and a wide Gaussian makes it Gaussian (central limit theorem).
    draw = rng.standard_normal if coarse < 1 else rng.random
    white = draw(grid, np.float32)
    if sigma < 0.3:
        return white
    mean, deviation = (0.0, 1.0) if coarse < 1 else (0.5, 12**-0.5)
    smooth = cv2.GaussianBlur(white, (0, 0), coarse, borderType=cv2.BORDER_REFLECT) - np.float32(mean)
    # A Gaussian filter multiplies the standard deviation of white noise by 1 / (2 sigma sqrt(pi)).
    return upsampled(np.float32(2 * coarse * np.sqrt(np.pi) / deviation) * smooth, stride, shape)


def upsampled(field: np.ndarray, stride: int, shape: tuple[int, ...]) -> np.ndarray:
    """A field on a grid with spacing `stride` px, interpolated to `shape`."""
    if stride == 1:
        return field
    height, width = field.shape[:2]
    large = cv2.resize(field, (stride * width, stride * height), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(large[: shape[0], : shape[1]])


@kernel
def _cast_shadows(flow: np.ndarray, foreground: np.ndarray, caster: np.ndarray, strength: float) -> None:
    """Add a share of the objects' flow to the background under their shadows. caster: `shadow_to_object` (2, 3)."""
    height, width = foreground.shape
    for y in range(height):
        for x in range(width):
            if foreground[y, x]:
                continue
            column = int(np.floor(caster[0, 0] * x + caster[0, 1] * y + caster[0, 2] + 0.5))
            row = int(np.floor(caster[1, 0] * x + caster[1, 1] * y + caster[1, 2] + 0.5))
            if 0 <= row < height and 0 <= column < width and foreground[row, column]:
                for k in range(2):
                    flow[y, x, k] += np.float32(strength) * flow[row, column, k]


@kernel
def _nearest(foreground: np.ndarray, near: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """`nearest_foreground` for the pixels where `near` (H, W) is not 0, by trying the offsets (K, 2) in order."""
    height, width = foreground.shape
    out = np.full((height, width), -1, np.int32)
    for y in range(height):
        for x in range(width):
            if near[y, x] and not foreground[y, x]:
                for i in range(len(offsets)):
                    row, column = y + offsets[i, 0], x + offsets[i, 1]
                    if 0 <= row < height and 0 <= column < width and foreground[row, column]:
                        out[y, x] = row * width + column
                        break
    return out


@kernel
def _leak(flow: np.ndarray, nearest: np.ndarray, field: np.ndarray, threshold: float) -> None:
    """Give background pixels whose `field` is above the threshold the flow of the nearest object pixel."""
    height, width = nearest.shape
    for y in range(height):
        for x in range(width):
            if nearest[y, x] >= 0 and field[y, x] > threshold:
                row, column = divmod(nearest[y, x], width)
                for k in range(2):
                    flow[y, x, k] = flow[row, column, k]


@kernel
def drop_out(flow: np.ndarray, foreground: np.ndarray, field: np.ndarray, threshold: float) -> None:
    """Set the flow of object pixels whose `field` is above the threshold to zero."""
    height, width = foreground.shape
    for y in range(height):
        for x in range(width):
            if foreground[y, x] and field[y, x] > threshold:
                flow[y, x] = 0


@kernel
def add_waver(
    flow: np.ndarray,
    foreground: np.ndarray,
    waver: np.ndarray,
    still: np.ndarray,
    scale: float,
    waver_px: float,
    waver_share: float,
) -> None:
    """Add the smooth error `waver` (H, W, 2) to moving pixels, and set the background's error `still` to 0 there."""
    height, width = foreground.shape
    for y in range(height):
        for x in range(width):
            length = np.sqrt(flow[y, x, 0] ** 2 + flow[y, x, 1] ** 2)
            if foreground[y, x] or length > 0.5 * scale:
                size = np.float32(waver_px * scale + waver_share * length)
                for k in range(2):
                    flow[y, x, k] += size * waver[y, x, k]
                    still[y, x, k] = 0


@kernel
def _flicker(blotches: np.ndarray, cells: np.ndarray, size: np.ndarray, cell: int) -> None:
    """Add the errors of cells (R, C, 2) to blotches (H, W, 2), and scale each cell by its size (R, C)."""
    height, width = blotches.shape[:2]
    for y in range(height):
        for x in range(width):
            row, column = y // cell, x // cell
            for k in range(2):
                blotches[y, x, k] = size[row, column] * (blotches[y, x, k] + cells[row, column, k])
