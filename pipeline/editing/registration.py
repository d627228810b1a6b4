"""Where the clip shows each body, against where the scene says: a shift and a factor of size per frame."""

from __future__ import annotations

import numpy as np

from pipeline.editing.camera_rays import cast_bodies
from pipeline.editing.view import BodyMotion, View

LEAST_SEEN = 0.97  # of a silhouette, from which on its mask can be compared with it
LEAST_IOU = 0.6  # of a mask and the silhouette that was brought to it
SCALES = 0.6, 1.6  # least and most factor of size
LEAST_AREA = 30  # px
SMOOTH = np.array([0.25, 0.5, 0.25])  # over frames


def identity(motion: BodyMotion, view: View) -> np.ndarray:
    """(T, N, 5) corrections that change nothing."""
    centres = motion.centres_px(view)
    return np.concatenate([centres, np.zeros_like(centres), np.ones((*centres.shape[:2], 1))], axis=-1)


def _silhouette(
    motion: BodyMotion, view: View, corrections: np.ndarray, rectangles: np.ndarray, frame: int, shown: np.ndarray
) -> np.ndarray:
    """(H, W) uint8 of one frame: the index of the body that is seen, or `camera_rays.NOBODY`."""
    size = view.height, view.width
    ids, depth, point = np.empty(size, np.uint8), np.empty(size, np.float32), np.empty((*size, 3), np.float32)
    body, correction, rectangle = motion.tables[frame], corrections[frame], rectangles[frame]
    cast_bodies(body, correction, rectangle, shown, *view.ray_arguments, ids, depth, point)
    return ids


def register(motion: BodyMotion, view: View, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bring the silhouettes of a motion to the masks of a clip.

    A body is compared with its mask where it is seen whole; between such frames its correction is interpolated.

    Args:
        motion: T frames, N bodies.
        view: The camera.
        masks: (T, H, W) uint8, i + 1 where body i is seen.

    Returns:
        Corrections (T, N, 5), as in `camera_rays`, and where they were measured, (T, N) bool.
    """
    frames, count = motion.shown.shape
    plain, out = identity(motion, view), identity(motion, view)
    rectangles = motion.rectangles(view)
    together = [_silhouette(motion, view, plain, rectangles, t, motion.shown[t]) for t in range(frames)]
    measured = np.zeros((frames, count), bool)
    for i in range(count):
        alone = np.arange(count) == i
        found = np.full((frames, 3), np.nan)
        for t in range(frames):
            if motion.shown[t, i]:
                body = _silhouette(motion, view, plain, rectangles, t, alone) == i
                correction = _match(body, together[t] == i, masks[t] == i + 1, plain[t, i])
                if correction is not None:
                    found[t] = correction
        known = np.flatnonzero(np.isfinite(found[:, 0]))
        measured[known, i] = True
        if not len(known):
            continue
        for k in range(3):
            series = np.interp(np.arange(frames), known, found[known, k])
            out[:, i, 2 + k] = np.convolve(np.pad(series, 1, mode="edge"), SMOOTH, mode="valid")
    return out, measured


def _match(body: np.ndarray, seen: np.ndarray, mask: np.ndarray, plain: np.ndarray) -> np.ndarray | None:
    """Shift du, dv (px) and factor that bring a silhouette to its mask; None where they cannot be compared."""
    area, own = int(mask.sum()), int(body.sum())
    if min(area, own) < LEAST_AREA or seen.sum() < LEAST_SEEN * own or _at_border(body) or _at_border(mask):
        return None
    scale = float(np.sqrt(area / own))
    if not SCALES[0] <= scale <= SCALES[1]:
        return None
    (rows, cols), (own_rows, own_cols) = np.nonzero(mask), np.nonzero(body)
    from_centre = np.array([own_cols.mean() + 0.5, own_rows.mean() + 0.5]) - plain[:2]
    shift = np.array([cols.mean() + 0.5, rows.mean() + 0.5]) - plain[:2] - scale * from_centre
    moved = _moved(body, plain[:2], shift, scale)
    if (moved & mask).sum() < LEAST_IOU * (moved | mask).sum():
        return None
    return np.array([*shift, scale])


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
