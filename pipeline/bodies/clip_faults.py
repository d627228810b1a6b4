"""What makes a clip unfit for masks from motion: a camera that moves, light that flickers."""

from __future__ import annotations

import itertools

import cv2
import numpy as np

from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.recordings.video import AREA

SHAKING_PX = 1.5  # of the background, from the clip's first frame: the camera moves
FLICKER = 0.04  # change of the whole picture's brightness from frame to frame
CELLS = 4, 3  # of the picture, across and down, that vote about the camera
LEAST_CELLS, QUARTER = 4, 25  # that vote; per cent of them, from the lowest, that decide
LEAST_CORNERS, MOST_CORNERS = 3, 25  # in a part that votes; that are followed there
PATCH = 11  # px, side of the square around a corner
LEAST_CONTRAST = 8.0  # of 255, standard deviation in the square: above a sensor's noise
ALIKE = 0.8  # correlation of two squares: they show the same
MUCH_LIKER = 0.02  # so much more alike has the square to be where the corner is followed to than where it was


def camera_shift(frames: np.ndarray, masks: np.ndarray) -> float:
    """How far the background moves from its place in the first frame, px of 480x320; 0 where it has no texture.

    Corners of the first frame that are in no mask are followed by Lucas and Kanade's method, as long as what is seen
    there, or still at their place, is like what was seen first. Each part of the picture has one vote, the median of
    its corners, of which the lower quartile counts: hands and bodies without a mask move in many parts, but nothing
    rests before a camera that moves.

    Args:
        frames: (T, H, W, 3) uint8.
        masks: (T, H, W), 0 for the background.
    """
    size = of_area((frames.shape[2], frames.shape[1]), AREA)
    grey = [cv2.resize(cv2.cvtColor(f, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA) for f in frames]
    ever = cv2.resize(np.asarray((masks > 0).any(0), np.uint8), size, interpolation=cv2.INTER_NEAREST)
    first, part = corners(grey[0], cv2.dilate(ever, np.ones((9, 9), np.uint8)) == 0)
    own = patches(grey[0], first)
    place, followed, largest = first.copy(), np.ones(len(first), bool), 0.0
    for before, after in itertools.pairwise(grey):
        if not followed.any():
            break
        moved, found, _ = cv2.calcOpticalFlowPyrLK(before, after, place, place.copy(), winSize=(15, 15), maxLevel=3)
        place, followed = moved, followed & (found.ravel() > 0)
        here, there = ((own * patches(after, p)).mean(1) for p in (first, place))
        stays = (here > ALIKE) & (here > there - MUCH_LIKER)
        shift = np.where(stays, 0.0, np.linalg.norm(place - first, axis=1))
        seen = stays | (followed & (there > ALIKE))
        voters = [(part == k) & seen for k in np.unique(part)]
        votes = [np.median(shift[v]) for v in voters if v.sum() >= LEAST_CORNERS]
        if len(votes) >= LEAST_CELLS:
            largest = max(largest, float(np.percentile(votes, QUARTER)))
    return largest


def corners(grey: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each part of a picture (H, W) uint8 where free (H, W): places (N, 2) float32 px, and parts (N,)."""
    height, width = grey.shape
    places: list[np.ndarray] = [np.zeros((0, 2), np.float32)]
    parts: list[int] = []
    for k in range(CELLS[0] * CELLS[1]):
        col, row = k % CELLS[0], k // CELLS[0]
        left, right = (width * c // CELLS[0] for c in (col, col + 1))
        top, bottom = (height * r // CELLS[1] for r in (row, row + 1))
        mask = free[top:bottom, left:right].astype(np.uint8)
        found = cv2.goodFeaturesToTrack(grey[top:bottom, left:right], MOST_CORNERS, 0.05, 8, mask=mask)
        if found is None:
            continue
        own = found.reshape(-1, 2) + np.array([left, top], np.float32)
        own = own[[cut(grey, p).std() > LEAST_CONTRAST for p in own]]
        places.append(own)
        parts += [k] * len(own)
    return np.concatenate(places).astype(np.float32), np.array(parts, int)


def cut(grey: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The square (S, S) of a picture (H, W) around a place (2,) px."""
    return cv2.getRectSubPix(grey, (PATCH, PATCH), (float(place[0]), float(place[1])))


def patches(grey: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N, S * S) of each place (N, 2): the square around it, of mean 0 and deviation 1, so that products correlate."""
    squares = np.array([cut(grey, p).ravel() for p in places], np.float32).reshape(len(places), PATCH * PATCH)
    squares -= squares.mean(1, keepdims=True)
    return np.asarray(squares / (squares.std(1, keepdims=True) + 1e-3))


def flicker(frames: np.ndarray) -> float:
    """Typical change of the whole picture's brightness from one frame to the next, as a share, of frames (T, H, W, 3).

    The picture's brightness is its median ratio to the clip's median picture, which moving bodies hardly change.
    """
    small = frames[:, ::4, ::4].astype(np.float32).mean(-1) + 4
    ratio = np.median((small / np.median(small, axis=0)).reshape(len(frames), -1), axis=1)
    return float(np.percentile(np.abs(np.diff(ratio)), 75))


def camera_moves(shift: float) -> str:
    """What is said of a camera that moves; shift: of the background, px of 480x320."""
    return (
        f"the camera moves: the background shifts by {shift:.1f} px of 480x320; it has to rest, so put it on "
        "something or stabilise the video first"
    )


def clip_faults(frames: np.ndarray, masks: np.ndarray) -> list[str]:
    """What is wrong with a clip (T, H, W, 3) uint8 with masks (T, H, W), a sentence each."""
    out = []
    shift, change = camera_shift(frames, masks), flicker(frames)
    if shift > SHAKING_PX:
        out.append(camera_moves(shift))
    if change > FLICKER:
        out.append(
            f"the light flickers: the whole picture's brightness changes by {change:.0%} from frame to frame, and what "
            "is taken for motion may be light"
        )
    return out
