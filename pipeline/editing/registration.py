"""Where the clip shows each body, against where the scene says: a shift and a factor of size per frame.

Silhouettes are cast anew for each shift, so that bodies may hide each other. Outlines of known shape in masks with
shadows are registered in `discovery/filmed/registration.py`, solids of unknown size in
`search/outlines/registration.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.editing.camera_rays import cast_bodies
from pipeline.editing.view import BodyMotion, View

LEAST_SEEN = 0.97  # of a silhouette, from which on its mask can be compared with it
LEAST_IOU = 0.6  # of a mask and the whole silhouette that was brought to it
LEAST_PART_IOU = 0.3  # the same of a part of a body, whose size is not measured
PART_ROUNDS = 8  # of bringing a part to its mask: what is seen of the body changes as it is moved
PART_PX = 0.1  # shift of the last round
SCALES = 0.6, 1.6  # least and most factor of size
LEAST_AREA = 30  # px
SMOOTH = np.array([0.25, 0.5, 0.25])  # over frames


def identity(motion: BodyMotion, view: View) -> np.ndarray:
    """(T, N, 5) corrections that change nothing."""
    centres = motion.centres_px(view)
    return np.concatenate([centres, np.zeros_like(centres), np.ones((*centres.shape[:2], 1))], axis=-1)


def register(motion: BodyMotion, view: View, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bring the silhouettes of a motion to the masks of a clip.

    A body that is seen whole gives a shift and a factor of size. Where only a part of it is seen, behind another body
    or at the border of the picture, the factor is interpolated between such frames, and the shift brings the centroid
    of the part that is seen to that of the mask. Where there is no mask, both are interpolated.

    Args:
        motion: T frames, N bodies.
        view: The camera.
        masks: (T, H, W) uint8, i + 1 where body i is seen.

    Returns:
        Corrections (T, N, 5), as in `camera_rays`, and where shifts were measured, (T, N) bool.
    """
    frames, count = motion.shown.shape
    rectangles, size, plain = motion.rectangles(view), (view.height, view.width), identity(motion, view)
    out = plain.copy()

    def silhouettes(t: int, corrections: np.ndarray, shown: np.ndarray) -> np.ndarray:
        """(H, W) uint8 of frame t, bodies (N,) bool with corrections (N, 5): the one that is seen, or `NOBODY`."""
        ids, depth, point = np.empty(size, np.uint8), np.empty(size, np.float32), np.empty((*size, 3), np.float32)
        cast_bodies(motion.tables[t], corrections, rectangles[t], shown, *view.ray_arguments, ids, depth, point)
        return ids

    together = [silhouettes(t, plain[t], motion.shown[t]) for t in range(frames)]
    measured = np.zeros((frames, count), bool)
    for i in range(count):
        alone, there = np.arange(count) == i, [int(t) for t in np.flatnonzero(motion.shown[:, i])]
        found = np.full((frames, 3), np.nan)
        for t in there:
            whole = _match(silhouettes(t, plain[t], alone) == i, together[t] == i, masks[t] == i + 1, plain[t, i])
            if whole is not None:
                found[t] = whole
        scale = _interpolated(found[:, 2], 1.0)
        for t in [t for t in there if np.isnan(found[t, 0])]:

            def shown(shift: np.ndarray, t: int = t, i: int = i, scale: float = scale[t]) -> np.ndarray:
                moved = plain[t].copy()
                moved[i, 2:] = *shift, scale
                not_hidden = (masks[t] == 0) | (masks[t] == i + 1)
                return (silhouettes(t, moved, np.arange(count) == i) == i) & not_hidden

            shift = _match_part(shown, masks[t] == i + 1, plain[t, i, :2])
            if shift is not None:
                found[t, :2] = shift
        measured[:, i] = np.isfinite(found[:, 0])
        for k, series in enumerate((_interpolated(found[:, 0], 0.0), _interpolated(found[:, 1], 0.0), scale)):
            out[:, i, 2 + k] = np.convolve(np.pad(series, 1, mode="edge"), SMOOTH, mode="valid")
    return out, measured


def _interpolated(series: np.ndarray, default: float) -> np.ndarray:
    """A series (T,) whose NaN are interpolated; `default` where there is nothing else."""
    known = np.flatnonzero(np.isfinite(series))
    return np.interp(np.arange(len(series)), known, series[known]) if len(known) else np.full(len(series), default)


def _match(body: np.ndarray, seen: np.ndarray, mask: np.ndarray, plain: np.ndarray) -> np.ndarray | None:
    """Shift du, dv (px) and factor that bring a silhouette to its mask; None where they cannot be compared."""
    area, own = int(mask.sum()), int(body.sum())
    if min(area, own) < LEAST_AREA or seen.sum() < LEAST_SEEN * own or _at_border(body) or _at_border(mask):
        return None
    scale = float(np.sqrt(area / own))
    if not SCALES[0] <= scale <= SCALES[1]:
        return None
    shift = _centroid(mask) - plain[:2] - scale * (_centroid(body) - plain[:2])
    moved = _moved(body, plain[:2], shift, scale)
    if (moved & mask).sum() < LEAST_IOU * (moved | mask).sum():
        return None
    return np.array([*shift, scale])


def _match_part(shown: Callable[[np.ndarray], np.ndarray], mask: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Shift (2,) px that brings what is seen of a body to its mask; None where they cannot be compared.

    Args:
        shown: What is seen of the body for a shift, (H, W) bool.
        mask: (H, W) bool.
        centre: (2,) px of the body's centre without a shift.
    """
    if mask.sum() < LEAST_AREA:
        return None
    target, shift = _centroid(mask), np.zeros(2)
    for _ in range(PART_ROUNDS):
        seen = shown(shift)
        step = target - (_centroid(seen) if seen.any() else centre + shift)
        shift = shift + step
        if np.abs(step).max() < PART_PX:
            break
    seen = shown(shift)
    return shift if (seen & mask).sum() >= LEAST_PART_IOU * (seen | mask).sum() else None


def _centroid(mask: np.ndarray) -> np.ndarray:
    """(2,) px: column and row."""
    rows, cols = np.nonzero(mask)
    return np.array([cols.mean() + 0.5, rows.mean() + 0.5])


def _moved(body: np.ndarray, centre: np.ndarray, shift: np.ndarray, scale: float) -> np.ndarray:
    """A silhouette (H, W) moved and scaled as a correction says."""
    height, width = body.shape
    u = centre[0] + (np.arange(width) + 0.5 - centre[0] - shift[0]) / scale
    v = centre[1] + (np.arange(height) + 0.5 - centre[1] - shift[1]) / scale
    cols, rows = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = ((rows >= 0) & (rows < height))[:, None] & ((cols >= 0) & (cols < width))
    return body[np.clip(rows, 0, height - 1)[:, None], np.clip(cols, 0, width - 1)] & inside


def _at_border(mask: np.ndarray) -> bool:
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
