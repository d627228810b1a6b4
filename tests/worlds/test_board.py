"""Boards of known size give the scale of the plane of motion."""

import cv2
import numpy as np
import pytest

from pipeline.errors import ParamsError
from pipeline.worlds.board import Board, board_scale


def checkerboard(square: int, columns: int, rows: int, squeeze: float = 1.0) -> np.ndarray:
    """(3, 320, 480, 3) uint8: a board of so many inner corners; its height times squeeze."""
    y, x = np.mgrid[: square * (rows + 1), : square * (columns + 1)] // square
    board = np.where((x + y) % 2, 235, 20).astype(np.uint8)
    board = cv2.resize(board, (board.shape[1], round(board.shape[0] * squeeze)), interpolation=cv2.INTER_AREA)
    picture = np.full((320, 480), 200, np.uint8)
    picture[40 : 40 + board.shape[0], 60 : 60 + board.shape[1]] = board
    return np.repeat(np.repeat(cv2.GaussianBlur(picture, (0, 0), 0.8)[None, ..., None], 3, 3), 3, 0)


def test_a_checkerboard_gives_the_scale() -> None:
    scale, doubt = board_scale(checkerboard(24, 7, 5), Board((7, 5), 0.03))
    assert scale.px_per_m == pytest.approx(800, rel=0.01)
    assert scale.by == "board"
    assert scale.error < 0.01
    assert doubt is None


def test_a_board_that_is_turned_away_is_a_doubt() -> None:
    scale, doubt = board_scale(checkerboard(24, 7, 5, squeeze=0.8), Board((7, 5), 0.03))
    assert "not parallel to the picture" in (doubt or "")
    assert scale.error > 0.1


def test_an_apriltag_gives_the_scale() -> None:
    tag = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 3, 96)
    picture = np.full((240, 320, 3), 230, np.uint8)
    picture[70:166, 90:186] = tag[..., None]
    scale, _ = board_scale(picture[None], Board(None, 0.08))
    assert scale.px_per_m == pytest.approx(1200, rel=0.02)


def test_a_board_that_is_not_there_is_an_error() -> None:
    with pytest.raises(ParamsError, match="no checkerboard of 7x5 inner corners is seen"):
        board_scale(np.full((2, 240, 320, 3), 128, np.uint8), Board((7, 5), 0.03))
    with pytest.raises(ParamsError, match="no AprilTag is seen"):
        board_scale(np.full((2, 240, 320, 3), 128, np.uint8), Board(None, 0.03))
