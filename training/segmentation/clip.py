"""One training clip: frames, exact instance masks, what moves and is no body, and the network's features."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.bodies.networks.inputs import ClipFeatures

RESTS, MOVES, UNSURE, UNSEEN = 0, 1, 2, 3
OTHER, BODY_SHADOW = 1, 2  # what moves and is no body: a hand, cloth or a mirror image; a shadow, where it is known
MOVES_PX, MOVES_DEG = 2.0, 15.0  # in a picture 240 px wide: from here on a body moves
UNSURE_PX, UNSURE_DEG = 0.6, 3.0  # below, it rests
FAINT = 5.0  # of 255: a body whose colour differs less from what is around it, in most frames, is not seen


@dataclass(frozen=True)
class DrawnClip:
    """What a clip shows, most before a camera records it.

    frames: (T, H, W, 3) float32, 0 to 255. mask: (T, H, W) uint8, 0 or the body's id. other: (T, H, W), 0, OTHER or
    BODY_SHADOW. centre: (T, N, 2) px, projected. radius: (T, N) px. state: (N,) RESTS, MOVES, UNSURE (between the two)
    or UNSEEN (too faint). recorded: the frames have a camera's noise and are uint8.
    """

    frames: np.ndarray
    mask: np.ndarray
    other: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    state: np.ndarray
    recorded: bool = False


@dataclass(frozen=True)
class TrainingClip:
    """A recorded clip with its labels, as `DrawnClip`, and the arrays of its `ClipFeatures`. frames: uint8, with steady
    exposure."""

    frames: np.ndarray
    mask: np.ndarray
    other: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    state: np.ndarray
    background: np.ndarray
    low: np.ndarray
    high: np.ndarray
    flicker: np.ndarray
    forward: np.ndarray
    backward: np.ndarray

    @property
    def features(self) -> ClipFeatures:
        return ClipFeatures(
            background=self.background,
            low=self.low,
            high=self.high,
            flicker=self.flicker,
            forward=self.forward,
            backward=self.backward,
        )


def largest_shifts(centre: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(N,) px: the largest distance of each body between two frames in which it is seen.

    centre: (T, N, 2) px. seen: (T, N) bool.
    """
    apart = np.linalg.norm(centre[:, None] - centre[None], axis=-1)
    return np.asarray(np.where(seen[:, None] & seen[None], apart, 0).max((0, 1)))


def state_of(shift_px: np.ndarray, turn_deg: np.ndarray) -> np.ndarray:
    """State (N,) uint8 of bodies by their largest shift and visible turn over the clip, both (N,)."""
    moves = (shift_px > MOVES_PX) | (turn_deg > MOVES_DEG)
    unsure = ~moves & ((shift_px > UNSURE_PX) | (turn_deg > UNSURE_DEG))
    return np.where(moves, MOVES, np.where(unsure, UNSURE, RESTS)).astype(np.uint8)


def faint(frames: np.ndarray, mask: np.ndarray, bodies: int) -> np.ndarray:
    """(N,) bool: bodies that hardly differ from their surroundings in most frames in which they are in view.

    frames: (T, H, W, 3) uint8, mask: (T, H, W) ids 1 to N.
    """
    out = np.zeros(bodies, bool)
    for i in range(1, bodies + 1):
        contrasts = []
        for frame, owner in zip(frames[::3], mask[::3], strict=True):
            own = (owner == i).astype(np.uint8)
            if not own.any():
                continue
            x, y, w, h = cv2.boundingRect(own)
            window = (slice(max(y - 6, 0), y + h + 6), slice(max(x - 6, 0), x + w + 6))
            inside = own[window] > 0
            ring = (cv2.dilate(own[window], np.ones((9, 9), np.uint8)) > 0) & (owner[window] == 0)
            ring &= cv2.dilate(own[window], np.ones((3, 3), np.uint8)) == 0
            if not ring.any():
                continue
            pixels, around = frame[window][inside].astype(np.float32), frame[window][ring].astype(np.float32)
            apart = np.abs(pixels.mean(0) - around.mean(0)).max()
            textured = max(pixels.std(0).max() - around.std(0).max(), 0.0) if len(pixels) > 8 else 0.0
            contrasts.append(apart + textured)
        out[i - 1] = bool(contrasts) and float(np.median(contrasts)) < FAINT
    return out
