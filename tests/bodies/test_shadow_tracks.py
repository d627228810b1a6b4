"""Shadows that follow bodies, made from known discs."""

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.tracks.shadow_tracks import shadows_among

HEIGHT, WIDTH, FRAMES, RADIUS = 90, 160, 12, 5
WALL = np.full((HEIGHT, WIDTH, 3), (190, 200, 185), np.uint8)
GREY = (WALL * 0.7).astype(np.uint8)  # of a shadow on the wall
START, STOP, BESIDE = (20, 60), (130, 30), (12, 4)


def clip_of(bodies: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, list[Track]]:
    """Frames and tracks of discs: the path (T, 2) px and the picture (H, W, 3) or a colour that shows in each."""
    frames = np.repeat(WALL[None], FRAMES, 0)
    rows, cols = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    tracks = []
    for path, look in bodies:
        pieces = {}
        for t, (x, y) in enumerate(path):
            disc = np.hypot(cols - x, rows - y) < RADIUS
            frames[t][disc] = np.broadcast_to(look, WALL.shape)[disc]
            pieces[t] = Piece(np.flatnonzero(disc), np.array([x, y]), RADIUS, frames[t][disc].mean(0) / 255)
        tracks.append(Track(path[-1], RADIUS, frames[0].reshape(-1, 3)[:48] / 255, pieces=pieces))
    return frames, tracks


PATH = np.linspace(START, STOP, FRAMES)
RED, BALL = np.array((200, 40, 30)), GREY.copy()
BALL[:, ::2] = 60  # grey too, with contrast inside


@pytest.mark.parametrize("body", [RED, BALL], ids=["red", "grey"])
@pytest.mark.parametrize("first", [True, False])
def test_of_a_body_and_its_shadow_the_body_stays(body: np.ndarray, first: bool) -> None:
    both = [(PATH, body), (PATH + BESIDE, GREY)]
    frames, tracks = clip_of(both if first else both[::-1])
    assert shadows_among(tracks, frames) == {1 if first else 0}


@pytest.mark.parametrize(
    "other",
    [
        (PATH + BESIDE, np.array((30, 60, 200))),  # of another colour
        (np.linspace((30, 80), (60, 70), FRAMES), GREY),  # elsewhere
        (np.repeat([[90.0, 70.0]], FRAMES, 0), GREY),  # at rest
        (PATH + BESIDE, np.array((250, 250, 250))),  # brighter
    ],
    ids=["coloured", "elsewhere", "at rest", "brighter"],
)
def test_what_is_no_shadow_stays(other: tuple[np.ndarray, np.ndarray]) -> None:
    frames, tracks = clip_of([(PATH, RED), other])
    assert not shadows_among(tracks, frames)
