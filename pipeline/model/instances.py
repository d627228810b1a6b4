"""The bodies of a clip as the words model reads them: of each in each frame a crop at its own scale, and its place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.compiled import kernel

WIDTH, HEIGHT = 240, 160  # px of the picture in which places are measured
SIDE = 32  # px of a crop
MARGIN = 1.12  # side of a crop, as a share of the longer side of its body's box
LEAST_PX = 6  # a body with fewer pixels in a frame is not seen there
CHANNELS = ("own", "others", "flow right", "flow down")
#: px of WIDTH x HEIGHT; flow is px per frame interval; the last four are 1 where the body touches that border.
PLACES = (
    "seen",
    "left",
    "right",
    "top",
    "bottom",
    "x",
    "y",
    "area",
    "flow x",
    "flow y",
    "at left",
    "at right",
    "at top",
    "at bottom",
)
FULL = 127  # of a crop's share of 1
FLOW_GAIN = 3.0  # flow of a third of the crop's half side per interval is FULL


@dataclass(frozen=True)
class Instances:
    """The bodies of a clip, in the order of their ids in the masks.

    Attributes:
        crops: (N, T, 4, SIDE, SIDE) int8: share of the body, share of other bodies (negative: outside of the picture),
            flow inside of the body less its mean.
        places: (N, T, 14) float32, `PLACES`; all 0 where the body is not seen.
        ids: (N,) in the masks, of the bodies that are seen in some frame.
        shape_prior: (N, 3) probability of each of `BASIC_SHAPES` by the network for shapes; None: not known.
    """

    crops: np.ndarray
    places: np.ndarray
    ids: np.ndarray
    shape_prior: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.ids)


def instances_of(masks: np.ndarray, flow: np.ndarray, shape_prior: np.ndarray | None = None) -> Instances:
    """The bodies of a clip.

    Args:
        masks: (T, H, W) uint8 of the first frames of the model's pairs, 0 background, else the body's id.
        flow: (T, h, w, 2), px of its own size per frame interval.
        shape_prior: (M, 3) probability of each of `BASIC_SHAPES` for ids 1 to M; None: not known.

    Returns:
        The bodies with at least LEAST_PX in some frame.
    """
    masks, flow = _sized(masks, flow)
    count = int(masks.max(initial=0))
    places = np.zeros((count, len(masks), len(PLACES)), np.float32)
    crops = np.zeros((count, len(masks), len(CHANNELS), SIDE, SIDE), np.int8)
    _measure(masks, flow, places)
    seen = np.flatnonzero(places[..., 0].any(1))
    _crop(masks, flow, places, crops)
    return Instances(crops[seen], places[seen], seen + 1, None if shape_prior is None else shape_prior[seen])


def _sized(masks: np.ndarray, flow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks and flow in WIDTH x HEIGHT, the flow in its px."""
    size = (WIDTH, HEIGHT)
    if masks.shape[1:] != size[::-1]:
        masks = np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST_EXACT) for m in masks])
    if flow.shape[1:3] != size[::-1]:
        scale = np.array([WIDTH / flow.shape[2], HEIGHT / flow.shape[1]], np.float32)
        flow = np.stack([cv2.resize(np.asarray(f, np.float32), size) for f in flow]) * scale
    return np.ascontiguousarray(masks, np.uint8), np.ascontiguousarray(flow, np.float32)


@kernel
def _measure(masks: np.ndarray, flow: np.ndarray, places: np.ndarray) -> None:
    """Fill places (N, T, 14)."""
    frames, height, width = masks.shape
    for t in range(frames):
        for i in range(len(places)):
            places[i, t, 1], places[i, t, 3] = width, height
        for y in range(height):
            for x in range(width):
                k = masks[t, y, x]
                if k == 0:
                    continue
                v = places[k - 1, t]
                v[1], v[2] = min(v[1], x), max(v[2], x + 1)
                v[3], v[4] = min(v[3], y), max(v[4], y + 1)
                v[5] += x + 0.5
                v[6] += y + 0.5
                v[7] += 1
                v[8] += flow[t, y, x, 0]
                v[9] += flow[t, y, x, 1]
        for i in range(len(places)):
            v = places[i, t]
            if v[7] < LEAST_PX:
                v[:] = 0
                continue
            v[0] = 1
            for k in (5, 6, 8, 9):
                v[k] /= v[7]
            v[10], v[11], v[12], v[13] = v[1] <= 0, v[2] >= width, v[3] <= 0, v[4] >= height


@kernel
def crop_square(place: np.ndarray) -> tuple[float, float, float]:
    """Left and top edge and side, px, of the crop of a body with `PLACES` (14,)."""
    side = MARGIN * max(place[2] - place[1], place[4] - place[3])
    return 0.5 * (place[1] + place[2]) - side / 2, 0.5 * (place[3] + place[4]) - side / 2, side


@kernel
def samples_along(step: float) -> int:
    """Samples of a crop's pixel along each side, for pixels of `step` px of the picture."""
    return 1 if step <= 0.75 else (2 if step <= 2 else 3)


@kernel
def _crop(masks: np.ndarray, flow: np.ndarray, places: np.ndarray, crops: np.ndarray) -> None:
    """Fill crops (N, T, 4, S, S)."""
    frames, height, width = masks.shape
    size = crops.shape[-1]
    for i in range(len(places)):
        for t in range(frames):
            v = places[i, t]
            if v[0] == 0:
                continue
            left, top, side = crop_square(v)
            step = side / size
            sub = samples_along(step)
            gain = FULL * FLOW_GAIN / (side / 2)
            for r in range(size):
                for c in range(size):
                    own, others, right, down = 0, 0, 0.0, 0.0
                    for a in range(sub):
                        y = math.floor(top + (r + (a + 0.5) / sub) * step)
                        for b in range(sub):
                            x = math.floor(left + (c + (b + 0.5) / sub) * step)
                            if x < 0 or y < 0 or x >= width or y >= height:
                                others -= 1
                                continue
                            k = masks[t, y, x]
                            if k == i + 1:
                                own += 1
                                right += flow[t, y, x, 0] - v[8]
                                down += flow[t, y, x, 1] - v[9]
                            elif k:
                                others += 1
                    crops[i, t, 0, r, c] = int(FULL * own / (sub * sub))
                    crops[i, t, 1, r, c] = int(FULL * others / (sub * sub))
                    if own:
                        crops[i, t, 2, r, c] = int(min(max(gain * right / own, -FULL), FULL))
                        crops[i, t, 3, r, c] = int(min(max(gain * down / own, -FULL), FULL))
