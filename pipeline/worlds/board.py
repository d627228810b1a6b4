"""A board of known size in the picture: a checkerboard or AprilTags, which give the scale of the plane of motion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.errors import ParamsError
from pipeline.worlds.scale import Scale

LEAST_ERROR = 0.005  # of the scale, as a share: corners are sure to a fraction of a pixel
OBLIQUE = 0.05  # share by which the board's two directions may differ in the picture
FRAMES = 8  # looked at; in some, a body may hide the board


@dataclass(frozen=True)
class Board:
    """A board in the plane of motion.

    Attributes:
        corners: Inner corners of a checkerboard, across and down; None for AprilTags (family 36h11).
        side: m, of one of its squares, or of a tag's black border.
    """

    corners: tuple[int, int] | None
    side: float

    @property
    def kind(self) -> str:
        return "AprilTag" if self.corners is None else "checkerboard of {}x{} inner corners".format(*self.corners)


def board_scale(frames: np.ndarray, board: Board) -> tuple[Scale, str | None]:
    """The scale that a board in frames (T, H, W, 3) uint8 gives, and a doubt where it is not parallel to the picture.

    Raises:
        ParamsError: It is in none of the frames that were looked at.
    """
    some = np.linspace(0, len(frames) - 1, min(len(frames), FRAMES)).round().astype(int)
    found = [s for k in some if len(s := _sides(cv2.cvtColor(frames[k], cv2.COLOR_RGB2GRAY), board))]
    if not found:
        raise ParamsError(f"--board: no {board.kind} is seen in the clip; valid: a board that is seen whole, and sharp")
    across, down = np.median(np.concatenate(found), axis=0)
    size = float(np.sqrt(across * down))
    spread = float(np.std(np.concatenate(found)) / size / np.sqrt(sum(map(len, found))))
    doubt = None
    if abs(across / down - 1) > OBLIQUE:
        doubt = (
            f"the board is not parallel to the picture: its squares are {across:.1f} px wide and {down:.1f} px high, "
            "and lengths are as unsure as that"
        )
    error = max(LEAST_ERROR, spread, abs(across / down - 1) / 2)
    return Scale(size / board.side, "board", error), doubt


def _sides(grey: np.ndarray, board: Board) -> np.ndarray:
    """(N, 2) px: of each square or tag, its side across and its side down; N of 0 where there is none."""
    if board.corners is None:
        tags = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
        outlines, _, _ = tags.detectMarkers(grey)
        ends = [np.asarray(o, float).reshape(4, 2) for o in outlines]
        lengths = [np.linalg.norm(np.roll(e, -1, 0) - e, axis=1) for e in ends]
        return np.array([(side[[0, 2]].mean(), side[[1, 3]].mean()) for side in lengths]).reshape(-1, 2)
    columns, rows = board.corners
    seen, places = cv2.findChessboardCornersSB(grey, (columns, rows), flags=cv2.CALIB_CB_ACCURACY)
    if not seen:
        return np.zeros((0, 2))
    grid = np.asarray(places, float).reshape(rows, columns, 2)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=-1)[:-1]
    down = np.linalg.norm(np.diff(grid, axis=0), axis=-1)[:, :-1]
    return np.stack([across.ravel(), down.ravel()], 1)
