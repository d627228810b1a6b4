"""Exact flow with the errors of a measured one, thousands of times cheaper than measuring it.

RAFT's errors are of six kinds, and each has its parameters: edges are blurred, because its grid is coarse; the
flow wavers a little, smoothly over some pixels and more so where it is long; parts of an object are taken for
background (drop-outs); the motion of objects leaks into the background beside them; shadows move along with their
objects; and the resting ground flickers, in blotches and in the cells of the coarse grid, most where it is dark or
plain. `fit_noise` measures most of the parameters on pairs of exact and estimated flow; `raft_noise` draws them as RAFT
has them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np

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


def noisy_flow(rng: np.random.Generator, flow_px: np.ndarray, masks: np.ndarray, noise: FlowNoise) -> np.ndarray:
    """flow_px (T, H, W, 2) of objects in masks (T, H, W), 0 is background, with `noise`; the same shape, float32."""
    scale = flow_px.shape[2] / REFERENCE_WIDTH
    out = np.empty(flow_px.shape, np.float32)
    shadow = shadow_place(rng, flow_px.shape[1:3]) if noise.shadow else None
    for t, (flow, mask) in enumerate(zip(flow_px, masks, strict=True)):
        seen, front = flow.astype(np.float32), mask > 0
        if shadow is not None:
            seen = shadowed(seen, front, shadow, noise.shadow)
        out[t] = noisy_frame(rng, seen, front, noise, scale)
    return out


def shadow_place(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """The affine map (2, 3) from a clip's objects to their shadows: squashed, and cast to a side."""
    height, width = shape
    squash = rng.uniform(0.25, 0.7)
    fall = rng.uniform(0.02, 0.2) * height
    return np.array([[1, rng.uniform(-0.3, 0.3), rng.uniform(-0.12, 0.12) * width],
                     [0, squash, (1 - squash) * height / 2 + fall]], np.float32)  # fmt: skip


def shadowed(flow: np.ndarray, foreground: np.ndarray, place: np.ndarray, strength: float) -> np.ndarray:
    """The flow with that of the shadows where no object is."""
    height, width = foreground.shape
    cast = cv2.warpAffine(flow * foreground[..., None], place, (width, height), flags=cv2.INTER_NEAREST)
    return np.where(foreground[..., None], flow, flow + np.float32(strength) * cast)


def noisy_frame(
    rng: np.random.Generator, flow: np.ndarray, foreground: np.ndarray, noise: FlowNoise, scale: float
) -> np.ndarray:
    """flow: (H, W, 2) float32 px. foreground: (H, W) bool. scale: px here to a px of 480x320."""
    still = scale * noise.still_px * still_noise(rng, flow.shape, noise, scale)
    if not foreground.any():
        return flow + still
    measured = leaked(rng, flow, foreground, noise, scale)
    if noise.dropout > 0:
        field = smooth_noise(rng, foreground.shape, scale * noise.dropout_px)
        lost = field > np.quantile(field[foreground], 1 - noise.dropout)
        measured = np.where((lost & foreground)[..., None], np.float32(0), measured)
    measured = blurred(measured, scale * noise.edge_px)
    waver = smooth_noise(rng, flow.shape, scale * noise.correlation_px)
    length = np.hypot(measured[..., :1], measured[..., 1:])
    moving = np.maximum(foreground[..., None], length > 0.5 * scale)
    return measured + np.where(moving, (noise.waver_px * scale + noise.waver_share * length) * waver, still)


def still_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: FlowNoise, scale: float) -> np.ndarray:
    """The error (H, W, 2) on the background over its standard deviation: smooth, or of cells and blotches."""
    cell = round(scale * noise.cell_px)
    if cell < 2:
        return smooth_noise(rng, shape, scale * noise.correlation_px)
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    cells = np.float32(CELL_SHARE**0.5) * rng.standard_normal((rows, columns, 2), dtype=np.float32)
    size = np.exp(noise.cell_spread * smooth_noise(rng, (rows, columns), 1.5))
    out, size = (np.repeat(np.repeat(x, cell, 0), cell, 1)[: shape[0], : shape[1]] for x in (cells, size))
    for sigma, share in BLOTCHES:
        out = out + np.float32(share**0.5) * smooth_noise(rng, shape, scale * sigma)
    return size[..., None] * out


def leaked(
    rng: np.random.Generator, flow: np.ndarray, foreground: np.ndarray, noise: FlowNoise, scale: float
) -> np.ndarray:
    """The flow with that of the nearest object in a share of the background within NEAR_PX of it."""
    if noise.leak == 0:
        return flow
    near, nearest = nearest_foreground(foreground, NEAR_PX * scale)
    rows, columns = np.nonzero(near)
    field = smooth_noise(rng, foreground.shape, scale * max(noise.dropout_px, 1))[rows, columns]
    if not len(rows):
        return flow
    taken = field >= np.quantile(field, 1 - noise.leak)
    out = flow.copy()
    out[rows[taken], columns[taken]] = flow[nearest[rows[taken], columns[taken], 0], nearest[rows, columns][taken, 1]]
    return out


def nearest_foreground(foreground: np.ndarray, distance_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Background within that distance of the foreground, (H, W) bool, and the foreground pixel nearest to each pixel,
    (H, W, 2) row and column."""
    away, labels = cv2.distanceTransformWithLabels(
        (~foreground).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros((labels.max() + 1, 2), np.int64)
    rows, columns = np.nonzero(foreground)
    place[labels[rows, columns]] = np.stack([rows, columns], axis=1)
    return ~foreground & (away <= distance_px), place[labels]


def blurred(field: np.ndarray, sigma: float) -> np.ndarray:
    return field if sigma < 0.1 else cv2.GaussianBlur(field, (0, 0), sigma)


def smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Gaussian noise of unit standard deviation, smoothed by a Gaussian of `sigma` px over the first two axes.

    Where it is much smoother than a pixel, it is drawn on a coarser grid and interpolated.
    """
    stride = max(1, int(sigma / 1.5))
    height, width = -(-shape[0] // stride), -(-shape[1] // stride)
    field = rng.standard_normal((height, width, *shape[2:]), dtype=np.float32)
    if sigma < 0.3:
        return field
    # White noise smoothed by a Gaussian keeps 1 / (2 sigma sqrt(pi)) of its standard deviation.
    coarse = sigma / stride
    gain = np.float32(2 * coarse * np.sqrt(np.pi))
    field = gain * cv2.GaussianBlur(field, (0, 0), coarse, borderType=cv2.BORDER_REFLECT)
    if stride == 1:
        return field
    return cv2.resize(field, (stride * width, stride * height), interpolation=cv2.INTER_LINEAR)[: shape[0], : shape[1]]


def fit_noise(exact_px: np.ndarray, estimated_px: np.ndarray, masks: np.ndarray) -> FlowNoise:
    """The parameters that give exact flow the errors seen in an estimate, by robust moments.

    exact_px, estimated_px: (T, H, W, 2). masks: (T, H, W), 0 is background. Raises ValueError where no object moves.
    """
    scale = exact_px.shape[2] / REFERENCE_WIDTH
    error = estimated_px.astype(np.float64) - exact_px
    length = np.linalg.norm(exact_px, axis=-1)
    foreground = masks > 0
    moving = foreground & (length > scale)
    if not moving.any():
        raise ValueError("no object moves by more than 1 px: nothing to fit the noise of flow to")
    inside = np.stack([cv2.erode(m.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0 for m in foreground])
    core = moving & inside if (moving & inside).any() else moving
    near = np.stack([nearest_foreground(m, NEAR_PX * scale)[0] if m.any() else m for m in moving])
    far = ~foreground & ~near

    # How much of the object's motion each pixel has: 1 in the object, 0 in the background.
    share = (estimated_px * exact_px).sum(-1)[moving] / length[moving] ** 2
    kept = core & ((estimated_px * exact_px).sum(-1) > 0.5 * length**2)
    waver_px, waver_share = spread_by_length(error[kept], length[kept])
    leaking = (np.linalg.norm(estimated_px, axis=-1) > 0.5 * nearby_length(length, moving)) & near
    return FlowNoise(
        edge_px=edge_width(estimated_px, exact_px, moving) / scale,
        waver_px=waver_px / scale,
        waver_share=waver_share,
        correlation_px=correlation_length(error, kept) / scale,
        still_px=float(robust_deviation(error[far])) / scale if far.any() else 0.0,
        dropout=float((share < 0.3).mean()),
        leak=float(leaking.sum() / max(near.sum(), 1)),
    )


def robust_deviation(values: np.ndarray) -> float:
    """Standard deviation of the values about zero, from their median length: outliers do not count."""
    return float(np.median(np.abs(values)) / 0.6745)


def spread_by_length(error: np.ndarray, length: np.ndarray) -> tuple[float, float]:
    """Deviation at rest, and what a px of flow adds to it: a line through the robust deviations of five quantiles."""
    if len(length) < 50:
        return (robust_deviation(error), 0.0) if len(error) else (0.0, 0.0)
    bins = np.clip(np.searchsorted(np.quantile(length, [0.2, 0.4, 0.6, 0.8]), length), 0, 4)
    x = np.array([length[bins == k].mean() for k in range(5) if (bins == k).any()])
    y = np.array([robust_deviation(error[bins == k]) for k in range(5) if (bins == k).any()])
    slope = max(float(np.polyfit(x, y, 1)[0]), 0.0) if np.ptp(x) > 1e-3 else 0.0
    return max(float(y.mean() - slope * x.mean()), 0.0), slope


def correlation_length(error: np.ndarray, where: np.ndarray) -> float:
    """Sigma of the Gaussian whose smoothing gives the errors' correlation between pixels at a distance of 4 px, px.

    White noise smoothed by sigma has the correlation exp(-d² / 4 sigma²) at a distance d.
    """
    d = 4
    both = where[:, :, d:] & where[:, :, :-d]
    if both.sum() < 20:
        return 0.0
    a, b = error[:, :, d:][both], error[:, :, :-d][both]
    limit = 4 * robust_deviation(np.concatenate([a, b])) + 1e-12
    a, b = np.clip(a, -limit, limit), np.clip(b, -limit, limit)
    r = float((a * b).sum() / max(np.sqrt((a**2).sum() * (b**2).sum()), 1e-12))
    return float(d / (2 * np.sqrt(-np.log(np.clip(r, 0.01, 0.99)))))


def nearby_length(length: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Length of the flow of the nearest moving pixel, (T, H, W) px; inf where nothing moves."""
    out = np.full(length.shape, np.inf)
    for t in range(len(length)):
        if moving[t].any():
            _, nearest = nearest_foreground(moving[t], 0)
            out[t] = length[t][nearest[..., 0], nearest[..., 1]]
    return out


def edge_width(estimated_px: np.ndarray, exact_px: np.ndarray, moving: np.ndarray) -> float:
    """Sigma, px, of the blur that an edge has: among a few, that which brings the exact flow nearest to the estimate
    in a band about the objects' edges (median of the distance)."""
    sigmas = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
    kernel = np.ones((7, 7), np.uint8)
    band = np.stack([cv2.morphologyEx(m.astype(np.uint8), cv2.MORPH_GRADIENT, kernel) > 0 for m in moving])
    errors = []
    for sigma in sigmas:
        blur = np.stack([blurred(f.astype(np.float32), sigma) for f in exact_px])
        errors.append(np.linalg.norm(blur - estimated_px, axis=-1)[band].mean())
    return sigmas[int(np.argmin(errors))]
