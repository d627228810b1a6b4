"""Exact masks with the errors of the network for masks.

Edges are off by a pixel or two, bodies grow or shrink, shadows count as bodies, one body takes a bite of another or
swallows it where they meet, and is lost in some frames. Now and then a body is missed altogether, found in part only,
lost for a while, or one with another, or there is one that does not exist.

The shares give a body an IoU of 0.69 on average over 246 bodies; the network for masks has 0.706 on 237 others
(`benchmarks/results/masks`), and 0.11 bodies a clip that do not exist.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from pipeline.compiled import kernel

FIELDS, PAD, SIGMA = 40, 64, 3.5  # fields of displacement, px around them, px of their correlation
AMPLITUDE = (0.4, 1.4)  # px, standard deviation of an edge's error
FARTHEST = 6.1  # standard deviations: no displacement is larger
SHADOWED = 0.3  # share of bodies whose shadow counts in part
MEETING = 0.3  # share of frames with touching boxes in which one body takes of the other
SWALLOWED = 0.2  # of these, in which it takes all
LOST = 0.03  # share of frames without a body
MISSED = 0.05  # share of bodies that are never found
PARTIAL = 0.08  # share of bodies of which a part is found only
AWAY = 0.1  # share of bodies that are lost for several frames
MERGED = 0.03  # share of bodies that are found as one with another
EXTRA = 0.1  # share of clips with a body that does not exist
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


@lru_cache(maxsize=4)
def _fields(height: int, width: int) -> np.ndarray:
    """Smooth displacements (FIELDS, height + PAD, width + PAD, 2), standard deviation 1."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((FIELDS, height + PAD, width + PAD, 2)).astype(np.float32)
    smooth = np.stack([cv2.GaussianBlur(n, (0, 0), SIGMA) for n in noise])
    return smooth / smooth.std()


def with_errors(masks: np.ndarray, objects: int, rng: np.random.Generator) -> np.ndarray:
    """Masks (T, H, W) uint8 of `objects` bodies with errors; a body that does not exist has the id objects + 1."""
    height, width = masks.shape[1:]
    amplitude, grown = rng.uniform(*AMPLITUDE), rng.choice([-1, 0, 0, 1])
    shadows = [_shadow(rng) if rng.random() < SHADOWED else None for _ in range(objects)]
    masks = _with_lasting_errors(masks, objects, rng)
    out = np.empty_like(masks)
    for t, exact in enumerate(masks):
        mask = _displaced(exact, amplitude, rng)
        if grown > 0:
            mask = np.where(mask == 0, cv2.dilate(mask, CROSS), mask)
        elif grown < 0:
            mask = mask * cv2.erode((mask > 0).astype(np.uint8), CROSS)
        boxes = _boxes(mask, objects)
        _bite(mask, boxes, rng)
        for i in range(objects):
            left, top, right, bottom = boxes[i]
            shadow = shadows[i]
            if shadow is not None and right > left:
                _draw_shadow(mask, i + 1, (left, top, right - left, bottom - top), shadow)
            if rng.random() < LOST:
                mask[mask == i + 1] = 0
        out[t] = mask
    if rng.random() < EXTRA:
        _add_fleck(out, objects + 1, rng, (width, height))
    return out


def _with_lasting_errors(masks: np.ndarray, objects: int, rng: np.random.Generator) -> np.ndarray:
    """The masks with what goes wrong in many frames: bodies that are missed, merged, cut, or lost for a while."""
    out = masks.copy()
    for body in range(1, objects + 1):
        draw = rng.random()
        if draw < MISSED and objects > 1:
            out[out == body] = 0
        elif MISSED <= draw < MISSED + MERGED and objects > 1:
            other = (body + int(rng.integers(objects - 1))) % objects + 1
            out[out == body] = other
        elif MISSED + MERGED <= draw < MISSED + MERGED + PARTIAL:
            angle, kept = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.7)
            for mask in out:
                _keep_part(mask, body, angle, kept)
        if rng.random() < AWAY:
            first = int(rng.integers(len(out)))
            part = out[first : first + int(rng.integers(2, 6))]
            part[part == body] = 0
    return out


def _keep_part(mask: np.ndarray, body: int, angle: float, kept: float) -> None:
    """Leave the share `kept` of a body, on one side of a line, in place."""
    rows, columns = np.nonzero(mask == body)
    if len(rows):
        along = np.cos(angle) * columns + np.sin(angle) * rows
        gone = along > np.quantile(along, kept)
        mask[rows[gone], columns[gone]] = 0


def _displaced(mask: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """The mask with wavering edges."""
    height, width = mask.shape
    field = _fields(height, width)[rng.integers(FIELDS)]
    a, b = rng.integers(PAD, size=2)
    out = np.zeros_like(mask)
    left, top, wide, high = cv2.boundingRect(mask)
    reach = math.ceil(FARTHEST * amplitude)
    rows = (max(top - reach, 0), min(top + high + reach, height))
    columns = (max(left - reach, 0), min(left + wide + reach, width))
    _look_up(mask, field[a : a + height, b : b + width], float(amplitude), rows, columns, out)
    return out


@kernel
def _look_up(
    mask: np.ndarray,
    field: np.ndarray,
    amplitude: float,
    rows: tuple[int, int],
    columns: tuple[int, int],
    out: np.ndarray,
) -> None:
    """Fill rows and columns (first, one past the last) of `out` with the mask moved by amplitude times the field."""
    height, width = mask.shape
    for y in range(rows[0], rows[1]):
        for x in range(columns[0], columns[1]):
            column = min(max(int(np.rint(x + amplitude * field[y, x, 0])), 0), width - 1)
            row = min(max(int(np.rint(y + amplitude * field[y, x, 1])), 0), height - 1)
            out[y, x] = mask[row, column]


@kernel
def _boxes(mask: np.ndarray, objects: int) -> np.ndarray:
    """(objects, 4) left, top, right, bottom; all 0 for a body without pixels."""
    out = np.zeros((objects, 4), np.int64)
    out[:, 0], out[:, 1] = mask.shape[1], mask.shape[0]
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            k = mask[y, x]
            if k:
                b = out[k - 1]
                b[0], b[1], b[2], b[3] = min(b[0], x), min(b[1], y), max(b[2], x + 1), max(b[3], y + 1)
    for b in out:
        if b[2] == 0:
            b[:] = 0
    return out


def _bite(mask: np.ndarray, boxes: np.ndarray, rng: np.random.Generator) -> None:
    """Where boxes meet, one body takes of the other now and then, in place."""
    for i, first in enumerate(boxes):
        for j, second in enumerate(boxes[:i]):
            apart = (first[:2] > second[2:]).any() or (second[:2] > first[2:]).any()
            if apart or not first[2] or not second[2] or rng.random() >= MEETING:
                continue
            taker, giver = (i + 1, j + 1) if rng.random() < 0.5 else (j + 1, i + 1)
            near = cv2.dilate((mask == taker).astype(np.uint8), CROSS)
            if not (near.astype(bool) & (mask == giver)).any():
                continue
            if rng.random() < SWALLOWED:
                mask[mask == giver] = taker
                continue
            side = 2 * int(rng.integers(1, 6)) + 1
            reach = cv2.dilate((mask == taker).astype(np.uint8), _ellipse(side)).astype(bool)
            mask[reach & (mask == giver)] = taker


@lru_cache(maxsize=16)
def _ellipse(side: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))


def _shadow(rng: np.random.Generator) -> tuple[float, float, float]:
    """Width, height and shift of a shadow, as shares of its body's box."""
    return rng.uniform(0.6, 1.1), rng.uniform(0.05, 0.2), rng.uniform(-0.4, 0.4)


def _draw_shadow(
    mask: np.ndarray, body: int, box: tuple[int, int, int, int], shadow: tuple[float, float, float]
) -> None:
    x, y, w, h = box
    wide, high, shift = shadow
    blob = np.zeros_like(mask)
    centre = int(x + w / 2 + shift * w), int(y + h - 0.5 * high * h)
    cv2.ellipse(blob, centre, (max(1, int(wide * w / 2)), max(1, int(high * h))), 0, 0, 360, 1, -1)
    mask[(blob > 0) & (mask == 0)] = body


def _add_fleck(masks: np.ndarray, body: int, rng: np.random.Generator, size: tuple[int, int]) -> None:
    """A body that does not exist in some neighbouring frames, in place."""
    first = int(rng.integers(len(masks)))
    last = first + int(rng.integers(1, len(masks) + 1))
    centre, radius = rng.uniform((0, 0), size), rng.uniform(2, 9, 2)
    step = rng.normal(0, 3, 2)
    for t in range(first, min(last, len(masks))):
        blob = np.zeros_like(masks[t])
        at = centre + (t - first) * step
        cv2.ellipse(blob, (int(at[0]), int(at[1])), (int(radius[0]), int(radius[1])), 0, 0, 360, 1, -1)
        masks[t][(blob > 0) & (masks[t] == 0)] = body
