"""Instance masks of moving objects in a clip of a static camera, from background subtraction and optical flow.

The background is the median over time. An object that rests for most of the clip is part of the median, and leaves a
ghost in the frames where it is elsewhere. The outline of a ghost is an edge of the background but not of the frame;
there the background is repaired. OpenCV's MOG2 (Zivkovic 2004), trained on the frames without their objects, then
classifies each pixel as background, object or shadow. Connected components are split where their flow differs, and
propagated from frame to frame along the flow, so that each object has one id.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import VideoError

DIFFERENT = 18  # of 255: difference of a channel from the background above which a pixel is foreground
SMALLEST_SHARE = 0.0004  # of the picture's area: smaller components are noise
SHORTEST = 3  # frames: shorter tracks are noise
LONGEST_GAP = 4  # frames for which an object may be lost
LEAST_SHIFT = 0.03  # displacement of a track relative to the largest one, below which it is noise
SLOW_PX = 0.3  # px at 480 px of width: flow below this is no motion
#: A component is split where the flow of its two parts differs by SPLIT_PX (at 480 px of width) and by SPLIT_RATIO
#: times the mean deviation within the parts. For the flow of a rolling object that ratio is 4.
SPLIT_PX, SPLIT_RATIO = 2.0, 10
OPEN, CLOSE = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)


def masks_from_motion(frames: np.ndarray, flow_px: np.ndarray) -> np.ndarray:
    """Segment and track the moving objects of a clip.

    An object that rests throughout is not found. A shadow may remain at the foot of an object.

    Args:
        frames: (T, H, W, 3) uint8.
        flow_px: (T - 1, H, W, 2), from frame t to frame t + 1.

    Returns:
        Ids (T, H, W) uint8: 0 for the background, objects from 1 in order of first appearance.

    Raises:
        VideoError: Nothing moves.
    """
    if len(flow_px) != len(frames) - 1 or flow_px.shape[1:3] != frames.shape[1:3]:
        raise ValueError(f"{len(frames)} frames need {len(frames) - 1} flows of their size, not {flow_px.shape}")
    flow = np.asarray(flow_px, np.float32)
    tracks = remove_noise(merge_tracks(track_objects(moving_pixels(frames), flow), flow), flow)
    if not tracks.any():
        raise VideoError(
            "nothing moves in this clip, or it is too small: masks from motion need a static camera and moving "
            "objects; give --masks, or another --start"
        )
    return tracks.astype(np.uint8)


def moving_pixels(frames: np.ndarray) -> np.ndarray:
    """Foreground (T, H, W) bool of frames (T, H, W, 3) uint8."""
    background = np.median(frames, axis=0).astype(np.uint8)
    smooth = np.stack([cv2.GaussianBlur(f, (0, 0), 0.8) for f in frames])
    for _ in range(2):
        rough = np.abs(smooth.astype(np.int16) - cv2.GaussianBlur(background, (0, 0), 0.8)).max(-1) > DIFFERENT
        background = repair_background(background, frames, rough)
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
        out[t] = fill_holes(body)
    return out


def repair_background(background: np.ndarray, frames: np.ndarray, rough: np.ndarray) -> np.ndarray:
    """Remove objects that rest for long from the background.

    A component of the foreground whose outline is a stronger edge in the background than in the frame is a ghost. There
    the background becomes the median of the frames that show it.

    Args:
        background: (H, W, 3) uint8.
        frames: (T, H, W, 3) uint8.
        rough: (T, H, W) bool, where the frames differ from the background.
    """
    ghosts = np.zeros(rough.shape, bool)
    edges = gradient_magnitude(background)
    least = SMALLEST_SHARE * rough[0].size
    for frame, away, ghost in zip(frames, rough, ghosts, strict=True):
        own = gradient_magnitude(frame)
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


def gradient_magnitude(picture: np.ndarray) -> np.ndarray:
    """Gradient magnitude (H, W) over all channels of a picture (H, W, 3) uint8."""
    picture = picture.astype(np.float32)
    return np.linalg.norm(np.concatenate([cv2.Sobel(picture, -1, 1, 0), cv2.Sobel(picture, -1, 0, 1)], -1), axis=-1)


def fill_holes(body: np.ndarray) -> np.ndarray:
    """A mask (H, W) without holes. Objects have none; parts with the colour of the background would leave them."""
    contours, _ = cv2.findContours(body, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros_like(body), contours, -1, 1, cv2.FILLED) > 0


def components(foreground: np.ndarray, flow: np.ndarray | None) -> list[np.ndarray]:
    """Masks (H, W) bool of the connected components of a frame, each split in two where its flow has two clusters.

    foreground: (H, W) bool. flow: (H, W, 2); None for the last frame.
    """
    least = SMALLEST_SHARE * foreground.size
    count, labels, stats, _ = cv2.connectedComponentsWithStats(foreground.astype(np.uint8))
    parts = [labels == k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= least]
    return parts if flow is None else [piece for part in parts for piece in split_by_flow(part, flow, least)]


def split_by_flow(part: np.ndarray, flow: np.ndarray, least: float) -> list[np.ndarray]:
    """One mask, or two where the flow has two distinct clusters that are both connected. least: smallest area, px."""
    samples = flow[part]
    if len(samples) < 4 * least:
        return [part]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.05)
    cv2.setRNGSeed(0)
    unknown = np.empty((len(samples), 1), np.int32)
    _, label, centre = map(np.asarray, cv2.kmeans(samples, 2, unknown, criteria, 2, cv2.KMEANS_PP_CENTERS))
    apart = np.linalg.norm(centre[0] - centre[1])
    within = np.linalg.norm(samples - centre[label[:, 0]], axis=1).mean()
    if apart < SPLIT_PX * part.shape[1] / 480 or apart < SPLIT_RATIO * within:
        return [part]
    halves = []
    for k in range(2):
        half = np.zeros(part.shape, np.uint8)
        half[part] = label[:, 0] == k
        count, labels, stats, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(half, cv2.MORPH_OPEN, OPEN))
        if count < 2:
            return [part]
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        # A thin rim of wrong flow around an object is not a second object.
        if stats[largest, cv2.CC_STAT_AREA] < max(least, 0.6 * half.sum()) or is_rim(labels == largest):
            return [part]
        halves.append(labels == largest)
    return nearest_of(halves, part)


def is_rim(mask: np.ndarray) -> bool:
    """Whether a mask is thin: nowhere wider than half the square root of its area."""
    return bool(2 * cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3).max() < 0.5 * np.sqrt(mask.sum()))


def nearest_of(seeds: list[np.ndarray], part: np.ndarray) -> list[np.ndarray]:
    """A mask (H, W) divided among seeds (H, W): each pixel belongs to the nearest one."""
    away = [cv2.distanceTransform((~s).astype(np.uint8), cv2.DIST_L2, 5) for s in seeds]
    owner = np.argmin(away, axis=0)
    return [part & (owner == k) for k in range(len(seeds))]


def track_objects(foreground: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Ids (T, H, W) int32 of the components of the foreground (T, H, W).

    A component has the id of the object that the flow propagates there. Where there are several, each pixel belongs to
    the nearest. Where there is none, the component is a new object.
    """
    ids = np.zeros(foreground.shape, np.int32)
    newest = 0
    for t in range(len(foreground)):
        predicted = propagate(ids[t - 1], flow[t - 1]) if t else ids[0].copy()
        claims: dict[int, tuple[int, np.ndarray]] = {}
        for part in components(foreground[t], flow[t] if t < len(flow) else None):
            here = [(int(i), int(n)) for i, n in zip(*np.unique(predicted[part], return_counts=True), strict=True)]
            found = [(i, n) for i, n in here if i and n > 0.15 * (predicted == i).sum()]
            pieces = nearest_of([part & (predicted == i) for i, _ in found], part) if found else [part]
            for piece, (i, n) in zip(pieces, found or [(0, 0)], strict=True):
                if i and i in claims and claims[i][0] >= n:
                    i = 0  # another component of this frame overlaps more with that object
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


def propagate(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Ids (H, W) in the next frame: each object is shifted by the median of its flow (H, W, 2)."""
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


def merge_tracks(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Merge tracks (T, H, W) that continue another track, or that are short-lived parts of one."""
    out = ids.copy()
    sizes = {int(i): int(n) for i, n in zip(*np.unique(ids[ids > 0], return_counts=True), strict=True)}
    for i in sorted(sizes, key=lambda k: sizes[k]):  # the smallest first
        mine = out == i
        seen = np.flatnonzero(mine.any(axis=(1, 2)))
        if not len(seen):
            continue
        whole = containing_track(out, i, mine, seen)
        before = preceding_track(out, i, mine, seen[0], flow)
        if whole:
            out[mine] = whole
        elif before:
            out[mine] = before
    return out


def containing_track(ids: np.ndarray, i: int, mine: np.ndarray, seen: np.ndarray) -> int:
    """The track that the short-lived track `i` touches in most of its frames; 0 where there is none.

    ids: (T, H, W). mine: (T, H, W) bool, the pixels of the track. seen: its frames.
    """
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


def preceding_track(ids: np.ndarray, i: int, mine: np.ndarray, first: int, flow: np.ndarray) -> int:
    """The track that ends up to `LONGEST_GAP` frames before `first` near the start of track `i`, with a similar area.

    ids: (T, H, W). mine: (T, H, W) bool, the pixels of the track. Returns 0 where there is none.
    """
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


def remove_noise(ids: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """At most 255 tracks that are long enough and move, numbered from 1 in order of first appearance.

    A track whose displacement (sum of the lengths of its pixels' flow) is small relative to the largest one is a
    reflection, flickering light or part of a shadow.
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
