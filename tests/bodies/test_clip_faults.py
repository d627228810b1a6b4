"""Clips without a body, or of a camera or light that is unfit: one clear sentence each."""

import drawn_clips
import numpy as np
import pytest

from pipeline.bodies.clip_faults import camera_shift, clip_faults, flicker
from pipeline.bodies.found_bodies import find_in_clip
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import mask_networks
from pipeline.errors import VideoError


def said(frames: np.ndarray) -> str:
    """The error of a clip in which no body is found."""
    with pytest.raises(VideoError) as error:
        find_in_clip(drawn_clips.clip(frames), mask_networks(), Prompts())
    return str(error.value)


@pytest.mark.parametrize("shift_px", [4.0, 10.0, 30.0])
def test_the_shift_of_a_camera_is_measured_in_px_of_480x320(shift_px: float, rng: np.random.Generator) -> None:
    frames = drawn_clips.recorded(rng, drawn_clips.panned(rng, shift_px))
    nothing = np.zeros(frames.shape[:3], np.uint8)
    assert camera_shift(frames, nothing) == pytest.approx(2 * shift_px, abs=0.5 + 0.05 * shift_px)


def test_a_hand_a_body_and_light_do_not_move_the_camera(rng: np.random.Generator) -> None:
    still = drawn_clips.still(rng)
    disc = drawn_clips.with_disc(still, drawn_clips.line((30, 50), (200, 90)), 20, (230, 60, 40))
    for frames in (still, disc, drawn_clips.with_hand(rng, still), drawn_clips.flickering(rng, still, 0.1)):
        recorded = drawn_clips.recorded(rng, frames)
        assert camera_shift(recorded, np.zeros(recorded.shape[:3], np.uint8)) < 1.5


def test_a_plain_wall_says_nothing_of_the_camera(rng: np.random.Generator) -> None:
    plain = drawn_clips.recorded(rng, np.full((10, 160, 240, 3), 120.0, np.float32))
    assert clip_faults(plain, np.zeros(plain.shape[:3], np.uint8)) == []


def test_flicker_is_the_change_of_the_whole_pictures_brightness(rng: np.random.Generator) -> None:
    still = drawn_clips.still(rng)
    disc = drawn_clips.with_disc(still, drawn_clips.line((30, 50), (200, 90)), 30, (230, 60, 40))
    assert flicker(drawn_clips.recorded(rng, disc)) < 0.01
    alternating = still * np.where(np.arange(len(still)) % 2, 1.1, 1.0)[:, None, None, None]
    assert flicker(drawn_clips.recorded(rng, alternating)) == pytest.approx(0.1, abs=0.02)


def test_a_clip_in_which_nothing_moves_says_so() -> None:
    rng = np.random.default_rng(1)
    assert said(drawn_clips.recorded(rng, drawn_clips.still(rng))).startswith("nothing moves in this clip")


@pytest.mark.parametrize("seed", range(3))
def test_a_hand_alone_is_named_and_is_no_body(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sentence = said(drawn_clips.recorded(rng, drawn_clips.with_hand(rng, drawn_clips.still(rng))))
    assert "looks like a hand" in sentence
    assert "--start" in sentence


def test_a_camera_that_moves_is_named_with_and_without_a_body() -> None:
    rng = np.random.default_rng(3)
    panned = drawn_clips.panned(rng, 12)
    assert "the camera moves: the background shifts by 2" in said(drawn_clips.recorded(rng, panned))
    disc = drawn_clips.with_disc(panned, drawn_clips.line((40, 60), (190, 90)), 12, (230, 60, 40))
    found = find_in_clip(drawn_clips.clip(drawn_clips.recorded(rng, disc)), mask_networks(), Prompts())
    assert any("the camera moves" in doubt for doubt in found.doubts)


def test_light_that_flickers_is_named_with_and_without_a_body() -> None:
    rng = np.random.default_rng(4)
    still = drawn_clips.still(rng)
    assert "the light flickers" in said(drawn_clips.recorded(rng, drawn_clips.flickering(rng, still, 0.12)))
    disc = drawn_clips.with_disc(still, drawn_clips.line((40, 60), (190, 90)), 12, (230, 60, 40))
    lit = drawn_clips.recorded(rng, drawn_clips.flickering(rng, disc, 0.12))
    found = find_in_clip(drawn_clips.clip(lit), mask_networks(), Prompts())
    assert len(found.bodies) == 1
    assert any("the light flickers" in doubt for doubt in found.doubts)
