"""Of a long recording, the stretch is chosen in which bodies move freely."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import drawn_clips
import numpy as np
import pytest

from pipeline.bodies.free_motion import fitted, free_way, longest_motion, stretch_of
from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.user_clip import mask_networks
from pipeline.errors import VideoError
from pipeline.vision.recordings.video import read_clip, write_video

TIMES = np.arange(60) / 30


def track(path: np.ndarray, radius: float = 6.0) -> Track:
    """The track of a disc along a path (T, 2) px, in pictures of 240x160 px."""
    pieces = {}
    y, x = np.mgrid[:160, :240]
    for k, centre in enumerate(path):
        inside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 < radius**2
        pieces[k] = Piece(np.flatnonzero(inside), centre, radius, np.zeros(3))
    return Track(path[-1], radius, np.zeros((1, 3)), pieces=pieces)


def found(hands: np.ndarray | None = None) -> Any:
    """Candidates with a picture (T, 160, 240) of where hands are."""
    empty = np.zeros((len(TIMES), 160, 240), np.float32)
    other = empty if hands is None else hands
    return SimpleNamespace(frames=np.zeros((*empty.shape, 3), np.uint8), prediction=SimpleNamespace(other=other))


def lifted_then_thrown() -> np.ndarray:
    """(T, 2) px: slowly moved and shaken for 0.8 s, then a second of flight."""
    rng = np.random.default_rng(2)
    held = np.linspace([30, 110], [36, 108], 25) + rng.normal(0, 0.2, (25, 2))
    t = (np.arange(35) + 1) / 30
    return np.concatenate([held, held[-1] + np.stack([150 * t, -180 * t + 150 * t**2], 1)])


def test_a_body_that_is_held_is_not_free_and_one_that_flies_is() -> None:
    low, high = longest_motion(*free_way([track(lifted_then_thrown())], found(), TIMES), TIMES)
    assert low == pytest.approx(24 / 30, abs=0.12)
    assert high == pytest.approx(TIMES[-1], abs=0.05)


def test_a_hand_at_a_body_that_moves_holds_it() -> None:
    path = np.linspace([20, 80], [220, 80], 60)
    hands = np.zeros((60, 160, 240), np.float32)
    for k in range(30):
        x = int(path[k, 0])
        hands[k, 70:90, max(x - 16, 0) : max(x - 4, 1)] = 0.9
    low, high = longest_motion(*free_way([track(path)], found(hands), TIMES), TIMES)
    assert low == pytest.approx(1.0, abs=0.1)
    assert high == pytest.approx(TIMES[-1], abs=0.05)


def test_the_motion_in_which_bodies_go_furthest_is_chosen_and_short_rests_are_part_of_it() -> None:
    way = np.zeros(60)
    way[2:8], way[20:30], way[33:40], way[55:] = 0.2, 0.3, 0.3, 0.1
    never = np.zeros(60, bool)
    assert longest_motion(way, never, TIMES) == pytest.approx((19 / 30, 39 / 30))
    assert longest_motion(np.zeros(60), never, TIMES) == (0.0, 0.0)


def test_a_motion_ends_where_a_body_leaves_the_picture_and_comes_back() -> None:
    path = np.stack([np.abs(np.linspace(180, -120, 60)) + 3, np.full(60, 80.0)], 1)  # touches the left border
    low, high = longest_motion(*free_way([track(path)], found(), TIMES), TIMES)
    assert low == pytest.approx(0.1, abs=0.1)
    assert high == pytest.approx(35 / 30, abs=0.1)


def test_a_body_that_trembles_beside_one_that_flies_rests() -> None:
    path = np.stack([np.linspace(20, 220, 60), np.full(60, 40.0)], 1)
    path[30:] = path[30]
    trembling = np.array([120.0, 120.0]) + np.random.default_rng(3).normal(0, 0.4, (60, 2))
    trembling[:3] += 9
    low, high = longest_motion(*free_way([track(path), track(trembling)], found(), TIMES), TIMES)
    assert high == pytest.approx(1.0, abs=0.1)
    assert low < 0.2


def test_a_stretch_has_the_length_that_is_asked_for_and_stays_in_the_file() -> None:
    assert fitted(1.0, 2.5, 10.0, None).seconds == pytest.approx(1.5)
    assert fitted(1.0, 1.1, 10.0, None).start == pytest.approx(0.975)
    assert fitted(1.0, 20.0, 30.0, None).seconds == 12
    assert (fitted(9.5, 10.0, 10.0, 2.0).start, fitted(9.5, 10.0, 10.0, 2.0).seconds) == (8.0, 2.0)


def no_network() -> Any:
    raise AssertionError("the network is not needed")


def test_short_files_and_what_the_user_says_need_no_look_at_the_motion(tmp_path: Path) -> None:
    pictures = np.stack([np.full((32, 48, 3), k, np.uint8) for k in range(60)])
    write_video(tmp_path / "short.mp4", pictures[:24], 30)
    write_video(tmp_path / "long.mp4", pictures, 30)
    np.savez(tmp_path / "masks.npz", masks=np.ones((20, 32, 48), np.uint8), times=0.5 + np.arange(20) / 30)
    asked = {"assume_fps": None, "start": None, "seconds": None, "masks": None}
    short = stretch_of(tmp_path / "short.mp4", no_network, **asked)
    assert (short.start, short.seconds, short.note) == (0, pytest.approx(0.8), None)
    said = stretch_of(tmp_path / "long.mp4", no_network, **asked | {"start": 0.3})
    assert (said.start, said.seconds) == (0.3, 1)
    masks = stretch_of(tmp_path / "long.mp4", no_network, **asked | {"masks": tmp_path / "masks.npz"})
    assert (masks.start, masks.seconds) == (0.5, pytest.approx(20 / 30))
    with pytest.raises(VideoError, match=r"is 2\.00 s long: a clip of 5 s does not fit"):
        stretch_of(tmp_path / "long.mp4", no_network, **asked | {"seconds": 5.0})


@pytest.mark.parametrize(("frames", "fps"), [(13, 15.15), (24, 30.0), (100, 120.0), (9, 10.0)])
def test_the_whole_of_a_short_file_can_be_read(tmp_path: Path, frames: int, fps: float) -> None:
    write_video(tmp_path / "clip.mp4", np.zeros((frames, 32, 48, 3), np.uint8), fps)
    part = stretch_of(tmp_path / "clip.mp4", no_network, assume_fps=None, start=None, seconds=None, masks=None)
    assert part.seconds == pytest.approx(frames / fps, abs=0.06)
    assert len(read_clip(tmp_path / "clip.mp4", part.start, part.seconds).frames) == frames


def test_a_disc_that_rests_and_then_moves_is_looked_at_while_it_moves(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    path = np.concatenate([np.repeat([[30.0, 60.0]], 30, 0), drawn_clips.line((30, 60), (200, 90))])
    still = np.concatenate([drawn_clips.still(rng)] * 2)[:1].repeat(len(path), 0)
    frames = drawn_clips.with_disc(still, path, 12, (230, 60, 40))
    write_video(tmp_path / "clip.mp4", drawn_clips.recorded(rng, frames), 30)
    asked = {"start": None, "seconds": None, "assume_fps": None, "masks": None}
    part = stretch_of(tmp_path / "clip.mp4", lambda: mask_networks().moving, **asked)
    assert part.start == pytest.approx(1.0, abs=0.15)
    assert part.start + part.seconds == pytest.approx(2.0, abs=0.1)
    assert "bodies move freely" in (part.note or "")
    write_video(tmp_path / "still.mp4", drawn_clips.recorded(rng, still), 30)
    with pytest.raises(VideoError, match="no body moves freely in it"):
        stretch_of(tmp_path / "still.mp4", lambda: mask_networks().moving, **asked)


def test_a_camera_that_moves_is_named_before_a_stretch_is_asked_for(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    panned = drawn_clips.panned(rng, 12)
    frames = drawn_clips.recorded(rng, np.concatenate([panned, panned[::-1]]))
    write_video(tmp_path / "clip.mp4", frames, 30)
    asked = {"start": None, "seconds": None, "assume_fps": None, "masks": None}
    with pytest.raises(VideoError, match="the camera moves: the background shifts by"):
        stretch_of(tmp_path / "clip.mp4", lambda: mask_networks().moving, **asked)
