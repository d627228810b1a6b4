"""Instance masks of what moves in a clip of a resting camera, from a background model and the flow; no learning.

The background is the median over time. Where a body rests for most of the clip it is in the median itself, and
leaves a ghost where it was not; such a ghost is told by its outline, which is an edge of the background and not of
the frame, and the background is repaired there. OpenCV's MOG2 (Zivkovic 2004), trained on the frames without their
bodies, then classifies each pixel as background, body or shadow. Connected components are split where their flow
differs and carried from frame to frame along the flow, which gives each body one id.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import VideoError

DIFFERENT = 18  # of 255: a channel that differs so much from the background is not noise
SMALLEST_SHARE = 0.0004  # of the picture's area; smaller components are noise
SHORTEST = 3  # frames; what is seen for less is noise
LONGEST_GAP = 4  # frames that a body may be lost for and be taken for the same
LEAST_SHIFT = 0.03  # of what the track shifts that shifts most
SLOW_PX = 0.3  # at 480 px of width: a flow below is no motion
APART_PX = 2.0  # at 480 px of width: parts of one component whose flow differs by more are two bodies
APART_SPREADS = 10  # and by so many times what it differs by inside each: a rolling body's even gradient has 4
OPEN, CLOSE = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)


def masks_from_motion(frames: np.ndarray, flow_px: np.ndarray) -> np.ndarray:
    """Ids of moving bodies, (T, H, W) uint8, 0 for the background, numbered from 1 by first appearance.

    frames: (T, H, W, 3) uint8. flow_px: (T - 1, H, W, 2), frame t to t + 1. A body that rests throughout is not
    found, and a shadow may be left at a body's foot. Raises VideoError where nothing moves.
    """
    if len(flow_px) != len(frames) - 1 or flow_px.shape[1:3] != frames.shape[1:3]:
        raise ValueError(f"{len(frames)} frames need {len(frames) - 1} flows of their size, not {flow_px.shape}")
    flow = np.asarray(flow_px, np.float32)
    tracks = without_noise(joined(track(moving_pixels(frames), flow), flow), flow)
    if not tracks.any():
        raise VideoError(
            "nothing moves in this clip (or too little is seen of it): masks from motion need a resting camera and "
            "bodies that move; give --masks, or another --start"
        )
    return tracks.astype(np.uint8)


def moving_pixels(frames: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: pixels that show something other than the background."""
    background = np.median(frames, axis=0).astype(np.uint8)
    smooth = np.stack([cv2.GaussianBlur(f, (0, 0), 0.8) for f in frames])
    for _ in range(2):
        rough = np.abs(smooth.astype(np.int16) - cv2.GaussianBlur(background, (0, 0), 0.8)).max(-1) > DIFFERENT
        background = without_ghosts(background, frames, rough)
    rough = np.abs(smooth.astype(np.int16) - cv2.GaussianBlur(background, (0, 0), 0.8)).max(-1) > DIFFERENT
    model = cv2.createBackgroundSubtractorMOG2(history=2 * len(frames), varThreshold=25, detectShadows=True)
    model.setShadowThreshold(0.55)
    for frame, away in zip(smooth, rough, strict=True):
        grown = cv2.dilate(away.astype(np.uint8), CLOSE)[..., None] > 0
        model.apply(np.where(grown, background, frame))
    out = np.empty(rough.shape, bool)
    for t, frame in enumerate(smooth):
        label = model.apply(frame, learningRate=0)
        body = ((label == 255) & rough[t]).astype(np.uint8)
        body = cv2.morphologyEx(cv2.morphologyEx(body, cv2.MORPH_OPEN, OPEN), cv2.MORPH_CLOSE, CLOSE)
        out[t] = filled(body)
    return out


def without_ghosts(background: np.ndarray, frames: np.ndarray, rough: np.ndarray) -> np.ndarray:
    """The background (H, W, 3), repaired where a body that rests for long had got into it.

    rough: (T, H, W) bool, where the frames differ from it. A component whose outline is a stronger edge in the
    background than in the frame is a ghost; there the background becomes the median of the frames that show it.
    """
    ghosts = np.zeros(rough.shape, bool)
    edges = gradient(background)
    least = SMALLEST_SHARE * rough[0].size
    for frame, away, ghost in zip(frames, rough, ghosts, strict=True):
        own = gradient(frame)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(away.astype(np.uint8))
        for k in range(1, count):
            if stats[k, cv2.CC_STAT_AREA] < least:
                continue
            part = (labels == k).astype(np.uint8)
            outline = cv2.morphologyEx(part, cv2.MORPH_GRADIENT, OPEN) > 0
            if edges[outline].mean() > 1.5 * own[outline].mean():
                ghost |= cv2.dilate(part, CLOSE) > 0
    there = ghosts.any(axis=0)
    repaired = background.copy()
    repaired[there] = np.ma.median(
        np.ma.array(frames[:, there], mask=np.repeat(~ghosts[:, there, None], 3, axis=-1)), axis=0
    ).astype(np.uint8)
    return repaired


def gradient(picture: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 to the length of the gradient of all channels together, (H, W)."""
    picture = picture.astype(np.float32)
    return np.linalg.norm(np.concatenate([cv2.Sobel(picture, -1, 1, 0), cv2.Sobel(picture, -1, 0, 1)], -1), axis=-1)


def filled(body: np.ndarray) -> np.ndarray:
    """A mask (H, W) with its holes closed: bodies have none, and a patch of the background's colour makes one."""
    contours, _ = cv2.findContours(body, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros_like(body), contours, -1, 1, cv2.FILLED) > 0


def components(foreground: np.ndarray, flow: np.ndarray | None) -> list[np.ndarray]:
    """Masks (H, W) bool of one frame's connected parts, each split in two where it moves in two ways.

    flow: (H, W, 2), None for the last frame.
    """
    least = SMALLEST_SHARE * foreground.size
    count, labels, stats, _ = cv2.connectedComponentsWithStats(foreground.astype(np.uint8))
    parts = [labels == k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= least]
    return parts if flow is None else [piece for part in parts for piece in split_by_flow(part, flow, least)]


def split_by_flow(part: np.ndarray, flow: np.ndarray, least: float) -> list[np.ndarray]:
    """One mask, or two where its flow has two clusters that are apart in motion and each in one piece."""
    samples = flow[part]
    if len(samples) < 4 * least:
        return [part]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.05)
    cv2.setRNGSeed(0)
    unknown = np.empty((len(samples), 1), np.int32)
    _, label, centre = map(np.asarray, cv2.kmeans(samples, 2, unknown, criteria, 2, cv2.KMEANS_PP_CENTERS))
    apart = np.linalg.norm(centre[0] - centre[1])
    within = np.linalg.norm(samples - centre[label[:, 0]], axis=1).mean()
    if apart < APART_PX * part.shape[1] / 480 or apart < APART_SPREADS * within:
        return [part]
    halves = []
    for k in range(2):
        half = np.zeros(part.shape, np.uint8)
        half[part] = label[:, 0] == k
        count, labels, stats, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(half, cv2.MORPH_OPEN, OPEN))
        if count < 2:
            return [part]
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        # A rim of wrong flow around a body is no second body.
        if stats[largest, cv2.CC_STAT_AREA] < max(least, 0.6 * half.sum()) or is_rim(labels == largest):
            return [part]
        halves.append(labels == largest)
    return nearest_of(halves, part)


def is_rim(mask: np.ndarray) -> bool:
    """Whether a mask is long and thin: nowhere wider than a quarter of the square root of its area."""
    return bool(2 * cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3).max() < 0.5 * np.sqrt(mask.sum()))


def nearest_of(seeds: list[np.ndarray], part: np.ndarray) -> list[np.ndarray]:
    """`part` (H, W) divided among the seeds, each pixel to the nearest."""
    away = [cv2.distanceTransform((~s).astype(np.uint8), cv2.DIST_L2, 5) for s in seeds]
    owner = np.argmin(away, axis=0)
    return [part & (owner == k) for k in range(len(seeds))]


def track(foreground: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Ids (T, H, W) int32 of the foreground's parts: each takes that of the body which the flow carries there.

    Where two bodies meet in one part, its pixels go to the nearer; a part that none is carried to is a new body.
    """
    ids = np.zeros(foreground.shape, np.int32)
    newest = 0
    for t in range(len(foreground)):
        carried = carry(ids[t - 1], flow[t - 1]) if t else ids[0].copy()
        claims: dict[int, tuple[int, np.ndarray]] = {}
        for part in components(foreground[t], flow[t] if t < len(flow) else None):
            here = [(int(i), int(n)) for i, n in zip(*np.unique(carried[part], return_counts=True), strict=True)]
            found = [(i, n) for i, n in here if i and n > 0.15 * (carried == i).sum()]
            pieces = nearest_of([part & (carried == i) for i, _ in found], part) if found else [part]
            for piece, (i, n) in zip(pieces, found or [(0, 0)], strict=True):
                if i and i in claims and claims[i][0] >= n:
                    i = 0  # another part of this frame is more of that body
                elif i and i in claims:
                    newest += 1
                    ids[t][claims[i][1]] = newest
                if not i:
                    newest += 1
                    i = newest
                else:
                    claims[i] = (n, piece)
                ids[t][piece] = i
    return ids


def carry(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Ids (H, W) moved along the flow to the next frame; each body moves as a whole by its median flow."""
    out = np.zeros_like(ids)
    for i in np.unique(ids[ids > 0]):
        dx, dy = np.median(flow[ids == i], axis=0)
        moved = cv2.warpAffine(
            (ids == i).astype(np.uint8),
            np.array([[1, 0, dx], [0, 1, dy]], np.float32),
            (ids.shape[1], ids.shape[0]),
            flags=cv2.INTER_NEAREST,
        )
        out[(moved > 0) & (out == 0)] = i
    return out


def joined(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Tracks (T, H, W) of which one goes on where another ends, or is a short-lived piece of another, made one."""
    out = ids.copy()
    sizes = {int(i): int(n) for i, n in zip(*np.unique(ids[ids > 0], return_counts=True), strict=True)}
    for i in sorted(sizes, key=lambda k: sizes[k]):  # the smallest first
        mine = out == i
        seen = np.flatnonzero(mine.any(axis=(1, 2)))
        if not len(seen):
            continue
        whole = best_whole(out, i, mine, seen)
        before = best_before(out, i, mine, seen[0], flow)
        if whole:
            out[mine] = whole
        elif before:
            out[mine] = before
    return out


def best_whole(ids: np.ndarray, i: int, mine: np.ndarray, seen: np.ndarray) -> int:
    """The track that a short-lived one touches in most of its frames; 0 where there is none."""
    if len(seen) > 0.25 * len(ids):
        return 0
    votes: dict[int, int] = {}
    for t in seen:
        rim = cv2.dilate(mine[t].astype(np.uint8), CLOSE) > 0
        for j in np.unique(ids[t][rim & ~mine[t]]):
            votes[int(j)] = votes.get(int(j), 0) + 1
    votes.pop(0, None)
    best = max(votes, key=lambda j: votes[j], default=0)
    return best if best and votes[best] > 0.5 * len(seen) else 0


def best_before(ids: np.ndarray, i: int, mine: np.ndarray, first: int, flow: np.ndarray) -> int:
    """The track that ended up to LONGEST_GAP frames before `first` where this one begins, and is as large; or 0."""
    centre, area = np.argwhere(mine[first]).mean(axis=0), mine[first].sum()
    for gap in range(1, LONGEST_GAP + 1):
        t = first - gap
        if t < 0:
            break
        for j in np.unique(ids[t][ids[t] > 0]):
            there = ids[t] == j
            if j == i or (ids[t + 1 :] == j).any() or not 0.5 < there.sum() / area < 2:
                continue
            dx, dy = np.median(flow[t][there], axis=0)
            expected = np.argwhere(there).mean(axis=0) + gap * np.array([dy, dx])
            if np.linalg.norm(expected - centre) < 0.75 * np.sqrt(area):
                return int(j)
    return 0


def without_noise(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """The tracks that last and move, numbered from 1 by first appearance, at most 255.

    A track that shifts hardly anything beside the one that shifts most (its pixels times their flow, summed) is a
    reflection, a flicker of light or a piece of a shadow.
    """
    out = np.zeros_like(ids)
    slow = SLOW_PX * ids.shape[2] / 480
    shifted = np.zeros(int(ids.max()) + 1)
    for i in range(1, len(shifted)):
        mine = ids == i
        seen = np.flatnonzero(mine.any(axis=(1, 2)))
        speeds = [float(np.median(np.linalg.norm(flow[t][mine[t]], axis=-1))) for t in seen if t < len(flow)]
        if len(seen) >= SHORTEST and max(speeds, default=0) > slow:
            shifted[i] = sum(s * mine[t].sum() for s, t in zip(speeds, seen, strict=False))
    kept = np.flatnonzero(shifted > LEAST_SHIFT * shifted.max(initial=0))[:255]
    for number, i in enumerate(kept, 1):
        out[ids == i] = number
    return out
