"""A body that somebody pointed at and the network does not see: a region grown there, and followed through the clip.

The region is what differs from the clip's median picture at the point, else what has its colour. It moves on with the
median of DIS flow in it, and GrabCut (Rother, Kolmogorov & Blake, SIGGRAPH 2004) draws its outline in each frame anew.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.tracks.image_track import LEAST_PIXELS

LEAST_DIFFERENCE = 12  # of 255, of a channel from the median picture: foreground; and 4 times the clip's noise
ALIKE = 9  # of 255, of each channel from the point's colour
MOST_SHARE = 0.25  # of the picture, of a region
CHANGES = 0.4, 2.5  # of a region's area from frame to frame: beyond, the body is lost
ROUNDS = 2  # of GrabCut


def region_at_point(frames: np.ndarray, t: int, point: np.ndarray) -> tuple[np.ndarray, str] | None:
    """The region (H, W) bool of frame t of a clip (T, H, W, 3) uint8 that has a point (2,) px, and what told it apart.

    None where nothing of a body's size can be told apart there.
    """
    for region, by in ((_moved(frames, t, point), "motion"), (_alike(frames[t], point), "colour")):
        if LEAST_PIXELS <= region.sum() <= MOST_SHARE * region.size:
            return region, by
    return None


def region_in_box(frames: np.ndarray, t: int, box: np.ndarray) -> np.ndarray:
    """The region (H, W) bool of frame t that a box (4,) px (left, top, right, bottom) holds."""
    height, width = frames.shape[1:3]
    left, top = np.floor(box[:2]).astype(int).clip(0, [width - 2, height - 2])
    right, bottom = np.ceil(box[2:]).astype(int).clip([left + 2, top + 2], [width, height])
    ellipse = np.zeros((height, width), np.uint8)
    middle = (float(left + right - 1) / 2, float(top + bottom - 1) / 2)
    cv2.ellipse(ellipse, (middle, (float(right - left), float(bottom - top)), 0.0), 1, -1)
    allowed = np.zeros((height, width), bool)
    allowed[top:bottom, left:right] = True
    return _cut(frames[t], ellipse > 0, allowed)


def grown_track(frames: np.ndarray, t: int, region: np.ndarray) -> Track:
    """The track of what fills a region (H, W) bool of frame t of a clip (T, H, W, 3) uint8, as far as it is seen."""
    pieces = {t: _piece(frames[t], region)}
    grey = [cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in frames]
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    for step in (1, -1):
        own, k = region, t
        while 0 <= k + step < len(frames):
            flow = search.calc(grey[k], grey[k + step], np.zeros((*own.shape, 2), np.float32))
            shift = np.median(flow[own], axis=0)
            moved = cv2.warpAffine(
                own.astype(np.uint8), np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32), own.shape[::-1]
            )
            reach = max(int(0.3 * (own.sum() / np.pi) ** 0.5), 2)
            allowed = cv2.dilate(moved, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
            seen = _cut(frames[k + step], moved > 0, allowed)
            if not CHANGES[0] * own.sum() <= seen.sum() <= CHANGES[1] * own.sum() or seen.sum() < LEAST_PIXELS:
                break
            own, k = seen, k + step
            pieces[k] = _piece(frames[k], own)
    last = pieces[max(pieces)]
    return Track(last.centre, last.radius, last.colour[None], pieces=pieces)


def _moved(frames: np.ndarray, t: int, point: np.ndarray) -> np.ndarray:
    """(H, W) bool: the connected part with the point of what differs from the clip's median picture."""
    background = np.median(frames, axis=0).astype(np.uint8)
    change = np.stack([cv2.absdiff(f, background).max(-1) for f in frames])
    differs = change[t] > max(LEAST_DIFFERENCE, 4 * float(np.median(change)))
    _, parts = cv2.connectedComponents(differs.astype(np.uint8))
    col, row = point.astype(int)
    near = parts[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
    number = near.max()
    return np.asarray((parts == number) & (number > 0))


def _alike(frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(H, W) bool: what is connected to the point and has its colour."""
    smooth = cv2.GaussianBlur(frame, (0, 0), 0.8)
    filled = np.zeros((frame.shape[0] + 2, frame.shape[1] + 2), np.uint8)
    flags = 4 | cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY | (1 << 8)
    col, row = (int(v) for v in point)
    cv2.floodFill(smooth, filled, (col, row), 0, (ALIKE,) * 3, (ALIKE,) * 3, flags)
    return np.asarray(filled[1:-1, 1:-1] > 0)


def _cut(frame: np.ndarray, probable: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """(H, W) bool: GrabCut's foreground, of masks (H, W) of what is probably the body and of where it may be."""
    out = np.zeros(allowed.shape, bool)
    if probable.sum() < LEAST_PIXELS:
        return out
    rows, cols = np.flatnonzero(allowed.any(1)), np.flatnonzero(allowed.any(0))
    pad = max(len(rows), len(cols)) // 2 + 4  # of background around it
    window = (slice(max(rows[0] - pad, 0), rows[-1] + pad + 1), slice(max(cols[0] - pad, 0), cols[-1] + pad + 1))
    core = cv2.erode(probable.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    labels = np.full(allowed.shape, cv2.GC_BGD, np.uint8)
    labels[allowed] = cv2.GC_PR_BGD
    labels[probable & allowed] = cv2.GC_PR_FGD
    labels[(core if core.any() else probable) & allowed] = (
        cv2.GC_FGD if core.sum() < 0.3 * probable.sum() else cv2.GC_PR_FGD
    )
    cut = np.ascontiguousarray(labels[window])
    if not (cut == cv2.GC_BGD).any():
        return probable & allowed
    cv2.setRNGSeed(0)  # it starts its colour clusters at random
    cv2.grabCut(
        np.ascontiguousarray(frame[window]),
        cut,
        (0, 0, 1, 1),
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        ROUNDS,
        cv2.GC_INIT_WITH_MASK,
    )
    out[window] = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(out.astype(np.uint8))
    return parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()) if count > 2 else out


def _piece(frame: np.ndarray, region: np.ndarray) -> Piece:
    rows, cols = np.nonzero(region)
    centre = np.array([cols.mean() + 0.5, rows.mean() + 0.5])
    return Piece(np.flatnonzero(region), centre, float((len(rows) / np.pi) ** 0.5), frame[region].mean(0) / 255)
