"""The parameters of a flow estimator's errors, from pairs of exact and estimated flow."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.vision.flow_noise import NEAR_PX, REFERENCE_WIDTH, FlowNoise, nearest_foreground


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
    nearest = np.stack([nearest_foreground(m, NEAR_PX * scale) for m in moving])
    near = nearest >= 0
    far = ~foreground & ~near

    # How much of the object's motion each pixel has: 1 in the object, 0 in the background.
    share = (estimated_px * exact_px).sum(-1)[moving] / length[moving] ** 2
    kept = core & ((estimated_px * exact_px).sum(-1) > 0.5 * length**2)
    waver_px, waver_share = spread_by_length(error[kept], length[kept])
    beside = np.stack([of_frame.ravel()[index] for of_frame, index in zip(length, nearest, strict=True)])
    leaking = near & (np.linalg.norm(estimated_px, axis=-1) > 0.5 * beside)
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


def edge_width(estimated_px: np.ndarray, exact_px: np.ndarray, moving: np.ndarray) -> float:
    """Sigma, px, of the blur that an edge has: among a few, that which brings the exact flow nearest to the estimate
    in a band about the objects' edges (median of the distance)."""
    sigmas = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
    kernel = np.ones((7, 7), np.uint8)
    band = np.stack([cv2.morphologyEx(m.astype(np.uint8), cv2.MORPH_GRADIENT, kernel) > 0 for m in moving])
    errors = []
    for sigma in sigmas:
        soft = exact_px.astype(np.float32)
        if sigma:
            soft = np.stack([cv2.GaussianBlur(flow, (0, 0), sigma) for flow in soft])
        errors.append(np.linalg.norm(soft - estimated_px, axis=-1)[band].mean())
    return sigmas[int(np.argmin(errors))]
