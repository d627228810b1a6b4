"""Exact flow with the errors of a measured one, thousands of times cheaper than measuring it.

RAFT's errors are of six kinds, and each has its parameters: edges are blurred, because its grid is coarse; the
flow wavers a little, smoothly over some pixels and more so where it is long; parts of an object are taken for
background (drop-outs); the motion of objects leaks into the background beside them; shadows move along with their
objects; and the resting ground flickers, in blotches and in the cells of the coarse grid, most where it is dark or
plain. `raft_noise` draws the parameters as RAFT has them; most were measured by `pipeline.vision.fit_flow_noise`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import cv2
import numpy as np

from pipeline.compiled import kernel

NEAR_PX = 6.0  # background within this distance of an object is where leaks are looked for, at 480 px of width
REFERENCE_WIDTH = 480


@dataclass(frozen=True)
class FlowNoise:
    """All lengths in px of 480x320; `noisy_flow` scales them to the flow's own size.

    edge_px: sigma of the blur of edges. waver_px: standard deviation of the smooth error on objects, at rest.
    waver_share: what is added to it, a share of the flow's length. correlation_px: sigma of the smoothing of that
    error. still_px: standard deviation of the error on the background; cell_px: side of the cells in which it is
    constant, beside larger blotches, 0: it is smooth; cell_spread: standard deviation of the logarithm of the cells'
    own deviations. dropout: share of an object's pixels that read as background. dropout_px: sigma of the patches that
    drop out. leak: share of the background beside an object that takes its motion. shadow: motion of shadows, a share
    of the objects'.
    """

    edge_px: float = 1.5
    waver_px: float = 0.15
    waver_share: float = 0.05
    correlation_px: float = 8.0
    still_px: float = 0.02
    dropout: float = 0.02
    dropout_px: float = 6.0
    leak: float = 0.15
    cell_px: float = 0.0
    cell_spread: float = 0.0
    shadow: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            if not 0 <= getattr(self, f.name) < np.inf:
                raise ValueError(f"{f.name} is zero or more, not {getattr(self, f.name)}")
        if max(self.dropout, self.leak, self.shadow) > 1:
            raise ValueError("dropout, leak and shadow are shares, at most 1")

    def scaled(self, strength: float) -> FlowNoise:
        """Every error `strength` times as large or as frequent; their scales of length stay."""
        sizes = ("edge_px", "waver_px", "waver_share", "still_px")
        shares = {name: min(1.0, strength * getattr(self, name)) for name in ("dropout", "leak", "shadow")}
        return replace(self, **shares, **{name: strength * getattr(self, name) for name in sizes})


NO_NOISE = FlowNoise(0, 0, 0, 0, 0, 0, 0, 0)

#: Low, high of the noise of a clip; uniform in the logarithm. About the 10th to 90th percentile of
#: `fit_noise` on 60 rendered clips with the shipped RAFT; clips differ that much by their light and texture.
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
CELL_PX = 16.0  # RAFT's coarse grid, 8 px of 240x160
#: Sigma, px, and share of the variance of what the background's error is made of beside its cells. The correlation at
#: 8, 16, 32, 64 and 128 px becomes 0.87, 0.67, 0.46, 0.24 and 0.08; that of RAFT's errors is 0.84, 0.71, 0.49, 0.23 and
#: 0.09 (60 clips, more than 24 px from objects).
BLOTCHES = ((8.0, 0.3), (24.0, 0.38), (64.0, 0.22))
CELL_SHARE = 0.1
SHADOWS = 0.7  # share of clips whose shadows move


def raft_noise(rng: np.random.Generator) -> FlowNoise:
    """The noise of one clip, drawn as RAFT has it."""
    drawn = {name: float(np.exp(rng.uniform(*np.log(limits)))) for name, limits in RAFT_RANGES.items()}
    shadow = rng.uniform(0.2, 1.0) if rng.random() < SHADOWS else 0.0
    return FlowNoise(**drawn, cell_px=CELL_PX, shadow=shadow)


def flow_like_rafts(
    rng: np.random.Generator, flow_px: np.ndarray, masks: np.ndarray, strength: float = 1.0
) -> np.ndarray:
    """`noisy_flow` with noise drawn as RAFT has it, `strength` times as strong."""
    return noisy_flow(rng, flow_px, masks, raft_noise(rng).scaled(strength))


def noisy_flow(rng: np.random.Generator, flow_px: np.ndarray, masks: np.ndarray, noise: FlowNoise) -> np.ndarray:
    """flow_px (T, H, W, 2) of objects in masks (T, H, W), 0 is background, with `noise`; the same shape, float32."""
    scale = flow_px.shape[2] / REFERENCE_WIDTH
    out = flow_px.astype(np.float32)
    shadow = shadow_place(rng, flow_px.shape[1:3]) if noise.shadow else None
    for flow, mask in zip(out, masks, strict=True):
        front = mask > 0
        if shadow is not None:
            _cast_shadows(flow, front, shadow, noise.shadow)
        disturb(rng, flow, front, noise, scale)
    return out


def shadow_place(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """The affine map (2, 3) from a clip's shadows, pixels (x, y, 1), to the objects that cast them: these are squashed,
    and cast to a side."""
    height, width = shape
    squash = rng.uniform(0.25, 0.7)
    fall = rng.uniform(0.02, 0.2) * height
    place = np.array([[1, rng.uniform(-0.3, 0.3), rng.uniform(-0.12, 0.12) * width],
                      [0, squash, (1 - squash) * height / 2 + fall]])  # fmt: skip
    return cv2.invertAffineTransform(place)


def disturb(rng: np.random.Generator, flow: np.ndarray, foreground: np.ndarray, noise: FlowNoise, scale: float) -> None:
    """Change a flow (H, W, 2) float32 px in place. foreground: (H, W) bool. scale: px here to a px of 480x320."""
    still = still_noise(rng, flow.shape, noise, scale)
    still *= np.float32(scale * noise.still_px)
    if foreground.any():
        part = bounds(foreground | (flow[..., 0] != 0) | (flow[..., 1] != 0), scale * max(NEAR_PX, 3 * noise.edge_px))
        disturb_motion(rng, flow[part], foreground[part], still[part], noise, scale)
    flow += still


def bounds(where: np.ndarray, margin_px: float) -> tuple[slice, slice]:
    """Rows and columns about what is True in `where` (H, W), and so many px more where there are."""
    x, y, width, height = cv2.boundingRect(where.view(np.uint8))
    margin = math.ceil(margin_px)
    return slice(max(y - margin, 0), y + height + margin), slice(max(x - margin, 0), x + width + margin)


def disturb_motion(
    rng: np.random.Generator, flow: np.ndarray, foreground: np.ndarray, still: np.ndarray, noise: FlowNoise,
    scale: float,
) -> None:  # fmt: skip
    """The errors at and about objects; `still`, those of the background, become 0 there."""
    if noise.leak > 0:
        nearest = nearest_foreground(foreground, NEAR_PX * scale)
        field = smooth_noise(rng, foreground.shape, scale * max(noise.dropout_px, 1))
        _leak(flow, nearest, field, highest(field[nearest >= 0], noise.leak))
    if noise.dropout > 0:
        field = smooth_noise(rng, foreground.shape, scale * noise.dropout_px)
        _drop_out(flow, foreground, field, highest(field[foreground], noise.dropout))
    if scale * noise.edge_px >= 0.1:
        flow[:] = cv2.GaussianBlur(flow, (0, 0), scale * noise.edge_px)
    waver = smooth_noise(rng, flow.shape, scale * noise.correlation_px)
    _waver(flow, foreground, waver, still, scale, noise.waver_px, noise.waver_share)


def highest(values: np.ndarray, share: float) -> float:
    """The one of values (V,) above which so large a share of them lies; -inf for all."""
    rank = len(values) - round(share * len(values)) - 1
    return float(np.partition(values, rank)[rank]) if rank >= 0 else -np.inf


def still_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: FlowNoise, scale: float) -> np.ndarray:
    """The error (H, W, 2) on the background over its standard deviation: smooth, or of cells and blotches."""
    cell = round(scale * noise.cell_px)
    if cell < 2:
        return smooth_noise(rng, shape, scale * noise.correlation_px)
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    cells = np.float32(CELL_SHARE**0.5) * rng.standard_normal((rows, columns, 2), dtype=np.float32)
    size = np.exp(np.float32(noise.cell_spread) * smooth_noise(rng, (rows, columns), 1.5))
    stride = coarseness(scale * BLOTCHES[0][0])
    coarse = (-(-shape[0] // stride), -(-shape[1] // stride), 2)
    blotches = np.zeros(coarse, np.float32)
    for sigma, share in BLOTCHES:
        blotches += np.float32(share**0.5) * smooth_noise(rng, coarse, scale * sigma / stride)
    out = enlarged(blotches, stride, shape)
    _flicker(out, cells, size, cell)
    return out


def nearest_foreground(foreground: np.ndarray, distance_px: float) -> np.ndarray:
    """(H, W) the foreground pixel, as row * W + column, that is nearest to each background pixel within so many px of
    one, of equal ones the first; -1 elsewhere. foreground: (H, W) bool."""
    disc, offsets = disc_within(distance_px)
    return _nearest(foreground, cv2.dilate(foreground.view(np.uint8), disc), offsets)


@lru_cache(maxsize=8)
def disc_within(distance_px: float) -> tuple[np.ndarray, np.ndarray]:
    """The pixels within a distance of one as a mask, and their offsets (K, 2) from it, row and column, near ones first;
    itself is not among these."""
    reach = int(distance_px)
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    away = np.hypot(*offsets.T)
    order = np.argsort(away, kind="stable")
    disc = (away <= distance_px).astype(np.uint8).reshape(2 * reach + 1, -1)
    return disc, offsets[order[1 : disc.sum()]]


def coarseness(sigma: float) -> int:
    """Of the grid, in px, on which noise smoothed by `sigma` px is drawn."""
    return max(1, int(sigma / 1.5))


def smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Gaussian noise of unit standard deviation, smoothed by a Gaussian of `sigma` px over the first two axes.

    Where it is much smoother than a pixel, it is drawn on a coarser grid and interpolated.
    """
    stride = coarseness(sigma)
    coarse = sigma / stride
    grid = (-(-shape[0] // stride), -(-shape[1] // stride), *shape[2:])
    # What a wide Gaussian makes of uniform noise, which is drawn faster, is Gaussian as well.
    draw = rng.standard_normal if coarse < 1 else rng.random
    white = draw(grid, np.float32)
    if sigma < 0.3:
        return white
    mean, deviation = (0.0, 1.0) if coarse < 1 else (0.5, 12**-0.5)
    smooth = cv2.GaussianBlur(white, (0, 0), coarse, borderType=cv2.BORDER_REFLECT) - np.float32(mean)
    # White noise smoothed by a Gaussian keeps 1 / (2 sigma sqrt(pi)) of its standard deviation.
    return enlarged(np.float32(2 * coarse * np.sqrt(np.pi) / deviation) * smooth, stride, shape)


def enlarged(field: np.ndarray, stride: int, shape: tuple[int, ...]) -> np.ndarray:
    """A field on a grid `stride` times as coarse, interpolated to `shape`."""
    if stride == 1:
        return field
    height, width = field.shape[:2]
    large = cv2.resize(field, (stride * width, stride * height), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(large[: shape[0], : shape[1]])


@kernel
def _cast_shadows(flow: np.ndarray, foreground: np.ndarray, caster: np.ndarray, strength: float) -> None:
    """Add a share of the objects' flow to the background that their shadows cover. caster: (2, 3), `shadow_place`."""
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
    """`nearest_foreground` where `near` (H, W) is not 0, trying the offsets (K, 2) in order."""
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
def _leak(flow: np.ndarray, nearest: np.ndarray, field: np.ndarray, least: float) -> None:
    """Give background whose `field` is more than `least` the flow of the object beside it."""
    height, width = nearest.shape
    for y in range(height):
        for x in range(width):
            if nearest[y, x] >= 0 and field[y, x] > least:
                row, column = divmod(nearest[y, x], width)
                for k in range(2):
                    flow[y, x, k] = flow[row, column, k]


@kernel
def _drop_out(flow: np.ndarray, foreground: np.ndarray, field: np.ndarray, most: float) -> None:
    """Take away the flow of objects where `field` is more than `most`."""
    height, width = foreground.shape
    for y in range(height):
        for x in range(width):
            if foreground[y, x] and field[y, x] > most:
                flow[y, x] = 0


@kernel
def _waver(
    flow: np.ndarray, foreground: np.ndarray, waver: np.ndarray, still: np.ndarray, scale: float, waver_px: float,
    waver_share: float,
) -> None:  # fmt: skip
    """Add the errors (H, W, 2) of what moves, where `still` (H, W, 2) then is 0."""
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
    """Add to blotches (H, W, 2) the errors of their cells (R, C, 2), and give each cell its size (R, C)."""
    height, width = blotches.shape[:2]
    for y in range(height):
        for x in range(width):
            row, column = y // cell, x // cell
            for k in range(2):
                blotches[y, x, k] = size[row, column] * (blotches[y, x, k] + cells[row, column, k])
