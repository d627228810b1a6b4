"""How far measured flow can be relied on, pixel by pixel.

Flow is measured where the flow back from where it leads returns (consistency), and where the picture has texture in
both directions: on a plain wall every flow fits, and flicker or noise decides. Both give factors in 0 to 1.
"""

from __future__ import annotations

import cv2
import numpy as np

RETURN_PX, RETURN_SHARE = 0.3, 0.1  # px, and share of the flow: a larger error of the way back has little weight
WINDOW_PX = 7  # side of the window in which texture is looked for
KNOWN_PX = 0.3  # standard deviation of the flow, by texture and noise, at which the confidence is a half
LEAST_NOISE = 1.0  # of 255: rounding and compression hide smaller noise
LEAST_KNOWN = 0.1  # of the background's pixels: where fewer are measured, they may all be shadows, and the camera rests
SLOPE_NOISE = 0.23  # variance of a slope by Scharr's filter, in units of the noise's


def consistency(flow: np.ndarray, back: np.ndarray) -> np.ndarray:
    """(H, W) in 0 to 1: whether the flow back, from where the flow (H, W, 2) px leads, returns to the pixel."""
    error = np.linalg.norm(flow + followed(back, flow), axis=-1)
    allowed = RETURN_PX + RETURN_SHARE * np.linalg.norm(flow, axis=-1)
    return np.asarray(np.exp(-((error / allowed) ** 2)))


def followed(field: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """A field (H, W, C) at the places to which the flow (H, W, 2) px leads; beyond the border, that at the border."""
    rows, cols = np.mgrid[: flow.shape[0], : flow.shape[1]].astype(np.float32)
    place = (cols + flow[..., 0].astype(np.float32), rows + flow[..., 1].astype(np.float32))
    return cv2.remap(field.astype(np.float32), *place, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def texture(frame_a: np.ndarray, frame_b: np.ndarray, flow: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Whether the slopes of frame a determine flow in both directions, beside the noise.

    The flow of a window has the variance noise^2 over the smaller eigenvalue of the sum of its slopes' products (Shi
    and Tomasi, CVPR 1994). Noise is what changes in the background, so flicker counts as noise.

    Args:
        frame_a: (H, W, 3) uint8 RGB.
        frame_b: (H, W, 3) uint8, the frame to which the flow leads.
        flow: (H, W, 2) px; where the background moves, its change is what is left with the flow.
        background: (H, W) bool.

    Returns:
        (H, W) in 0 to 1.
    """
    grey_a, grey_b = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32) for frame in (frame_a, frame_b))
    changes = [np.median(np.abs(grey - grey_a)[background]) for grey in (grey_b, followed(grey_b, flow))]
    noise = max(LEAST_NOISE, float(min(changes)) / (0.6745 * np.sqrt(2))) if background.any() else LEAST_NOISE
    across, down = (cv2.Scharr(grey_a, cv2.CV_32F, *order) / 32 for order in ((1, 0), (0, 1)))
    xx, xy, yy = (
        cv2.boxFilter(product, -1, (WINDOW_PX, WINDOW_PX), normalize=False)
        for product in (across * across, across * down, down * down)
    )
    smaller = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    smaller = np.maximum(smaller - WINDOW_PX**2 * SLOPE_NOISE * noise**2, 0)
    return np.asarray(smaller / (smaller + (noise / KNOWN_PX) ** 2))


def settled_background(flow: np.ndarray, confidence: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Flow (H, W, 2) px whose background, as far as it was not measured, has the motion of the whole background.

    confidence: (H, W) in 0 to 1. background: (H, W) bool.
    """
    motion, share = background_motion(flow, confidence, background), confidence[..., None]
    return np.asarray(np.where(background[..., None], share * flow + (1 - share) * motion, flow), np.float32)


def background_motion(flow: np.ndarray, confidence: np.ndarray, background: np.ndarray) -> np.ndarray:
    """The median flow (2,) px of the background where it was measured; 0 where that is too little or does not agree."""
    known = flow[background & (confidence > 0.5)]
    if len(known) < LEAST_KNOWN * background.sum() or not len(known):
        return np.zeros(2)
    motion = np.median(known, axis=0)
    agree = np.linalg.norm(known - motion, axis=-1) < RETURN_PX + RETURN_SHARE * np.linalg.norm(motion)
    return motion if agree.mean() > 0.5 else np.zeros(2)
