"""Errors of centres are estimated from frames in which the body moves."""

import numpy as np
import pytest

from pipeline.bodies.tracks.image_track import centre_sigma
from pipeline.discovery.filmed.centre_errors import MOST_AT_REST, USUAL_SIGMA, centre_error, independent_frames
from pipeline.worlds.arcs import LEAST_SIGMA


def stopping(moving: int, rests: int, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """(T, 2) px, a body that moves by 3 px a frame, seen with white noise, and then rests, always seen alike."""
    way = 3.0 * np.arange(moving)[:, None] * [0.8, 0.6] + rng.normal(0, sigma, (moving, 2))
    return np.concatenate([way, np.repeat(way[-1:], rests, 0)])


def test_frames_of_a_body_that_rests_do_not_tell_its_error(rng: np.random.Generator) -> None:
    sigma = 0.3
    found = [centre_error(stopping(14, 20, sigma, rng)) for _ in range(50)]
    assert np.mean(found) == pytest.approx(np.hypot(sigma, LEAST_SIGMA), rel=0.3)
    assert np.mean([centre_sigma(stopping(14, 20, sigma, rng)) for _ in range(50)]) < sigma / 3


def test_where_few_frames_tell_the_error_is_the_usual_one(rng: np.random.Generator) -> None:
    assert centre_error(stopping(3, 20, 0.3, rng)) == USUAL_SIGMA


def test_of_the_frames_at_rest_a_few_are_kept_with_the_first_and_the_last(rng: np.random.Generator) -> None:
    kept = independent_frames(stopping(10, 20, 0.1, rng))
    assert kept[:10].all() and kept[-1]
    assert kept[9:].sum() == MOST_AT_REST


@pytest.mark.parametrize("rests", [0, 1, 2])
def test_a_body_that_hardly_rests_keeps_all_frames(rests: int, rng: np.random.Generator) -> None:
    assert independent_frames(stopping(8, rests, 0.1, rng)).all()


def test_a_body_that_never_moves_is_left_with_a_few_frames() -> None:
    assert independent_frames(np.full((30, 2), 7.0)).sum() == MOST_AT_REST
