"""Corrections of frames that a user asks for: lens distortion by one coefficient, and a camera's small shake.

Distortion: Brown's first radial term ("Decentering distortion of lenses", 1966). Shake: each frame is mapped onto the
first one by the homography of its background, from corners that Lucas and Kanade's method follows, by RANSAC.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.errors import ParamsError, VideoError

MOST_DISTORTION = 0.3  # beyond it, the picture would fold at its corners
MOST_CORNERS, QUALITY, APART_PX = 400, 0.01, 8  # that are followed
LEAST_CORNERS, LEAST_SHARE = 12, 0.5  # that agree on a homography, and their share of those that are followed
AGREE_PX = 1.5  # of a corner with the homography
WINDOW = (21, 21)  # px, of Lucas and Kanade's method


@dataclass(frozen=True)
class Correction:
    """What is corrected in the frames of a recording.

    Attributes:
        distortion: A point at the distance r from the picture's centre, in units of half the diagonal, is seen at
            r (1 + distortion r²): negative for barrel distortion.
        steady: The camera's shake is removed.
    """

    distortion: float = 0.0
    steady: bool = False

    def __post_init__(self) -> None:
        if not abs(self.distortion) <= MOST_DISTORTION:
            raise ParamsError(
                f"--distortion {self.distortion:g}: valid: -{MOST_DISTORTION:g} to {MOST_DISTORTION:g}; a point at the "
                "corner is seen at 1 + K of its distance from the centre"
            )

    def __bool__(self) -> bool:
        return bool(self.distortion or self.steady)

    def apply(self, frames: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Corrected frames (T, H, W, 3) uint8, and a note on each correction. Raises VideoError."""
        notes = []
        if self.distortion:
            frames = undistorted(frames, self.distortion)
            notes.append(f"lens distortion of {self.distortion:g} was corrected (--distortion)")
        if self.steady:
            frames, most = without_shake(frames)
            notes.append(f"the camera's shake of up to {most:.1f} px was removed (--steady)")
        return frames, notes


def undistorted(frames: np.ndarray, distortion: float) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 as a lens without distortion shows them."""
    height, width = frames.shape[1:3]
    x = np.arange(width, dtype=np.float32) + 0.5 - width / 2
    y = np.arange(height, dtype=np.float32)[:, None] + 0.5 - height / 2
    factor = 1 + distortion * (x**2 + y**2) / (width**2 + height**2) * 4
    columns, rows = (x * factor + width / 2 - 0.5, y * factor + height / 2 - 0.5)
    places = columns.astype(np.float32), rows.astype(np.float32)
    return np.stack(
        [cv2.remap(f, places[0], places[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for f in frames]
    )


def without_shake(frames: np.ndarray) -> tuple[np.ndarray, float]:
    """Frames (T, H, W, 3) uint8 mapped onto the first one, and the largest shift of a corner of the picture, px.

    Raises:
        VideoError: The background has too few corners that move alike.
    """
    height, width = frames.shape[1:3]
    grey = [cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in frames]
    found = cv2.goodFeaturesToTrack(grey[0], MOST_CORNERS, QUALITY, APART_PX)
    first = np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)
    border = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], np.float32)
    out, place, most = [frames[0]], first.copy(), 0.0
    for frame, picture in zip(grey[1:], frames[1:], strict=True):
        turn = _homography(grey[0], frame, first, place)
        place = cv2.perspectiveTransform(first[None], turn)[0]
        most = max(most, float(np.linalg.norm(cv2.perspectiveTransform(border, turn) - border, axis=-1).max()))
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        out.append(cv2.warpPerspective(picture, turn, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE))
    return np.stack(out), most


def _homography(first: np.ndarray, now: np.ndarray, corners: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """(3, 3) from the first frame to another, both (H, W) uint8, of the background's corners (N, 2) px.

    guess: (N, 2) px, where they are about.
    """
    if len(corners) >= LEAST_CORNERS:
        moved, ok, _ = cv2.calcOpticalFlowPyrLK(
            first, now, corners, guess.copy(), winSize=WINDOW, maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        seen = ok.ravel() > 0
        if seen.sum() >= LEAST_CORNERS:
            cv2.setRNGSeed(0)
            turn, agree = cv2.findHomography(corners[seen], moved[seen], cv2.RANSAC, AGREE_PX)
            if turn is not None and agree.sum() >= max(LEAST_CORNERS, LEAST_SHARE * seen.sum()):
                return np.asarray(turn)
    raise VideoError(
        "--steady: the background has too few corners that move alike; valid: a background with texture, and a camera "
        "that shakes little"
    )
