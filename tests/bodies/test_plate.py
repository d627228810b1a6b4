"""Laws of the background without the bodies that are found."""

import numpy as np

from pipeline.bodies.networks.plate import LEAST_CLEAR, MARGIN_PX, clear_plate


def resting_square(rng, count=12, leaves=8):
    """A clip (T, H, W, 3) of a square that rests until frame `leaves`, what covers it (T, H, W), and the background."""
    picture = rng.integers(60, 120, (40, 60, 3), dtype=np.uint8)
    frames, covered = np.stack([picture] * count), np.zeros((count, 40, 60), bool)
    for t in range(count):
        left = 10 + (6 * (t - leaves + 1) if t >= leaves else 0)
        frames[t, 15:25, left : left + 10] = 220
        covered[t, 15:25, left : left + 10] = True
    return frames, covered, picture


def test_a_body_that_rests_for_most_of_the_clip_is_in_the_median_and_not_in_the_clear_plate():
    frames, covered, picture = resting_square(np.random.default_rng(0))
    median = np.median(frames, axis=0).astype(np.uint8)
    assert (median[15:25, 10:20] == 220).all()
    np.testing.assert_array_equal(clear_plate(frames, covered, median)[0], picture)


def test_without_bodies_the_background_stays():
    rng = np.random.default_rng(1)
    frames = rng.integers(0, 255, (5, 20, 30, 3), dtype=np.uint8)
    background = rng.integers(0, 255, (20, 30, 3), dtype=np.uint8)
    np.testing.assert_array_equal(clear_plate(frames, np.zeros((5, 20, 30), bool), background)[0], background)


def test_where_a_body_nearly_always_is_the_background_is_filled_in_from_around_it():
    frames, covered, _ = resting_square(np.random.default_rng(2), leaves=12 - LEAST_CLEAR + 2)
    median = np.median(frames, axis=0).astype(np.uint8)
    plate, filled = clear_plate(frames, covered, median)
    assert (median[15:25, 10:20] == 220).all() and filled[15:25, 10:20].all() and not filled[:10].any()
    assert (plate[15:25, 10:20] >= 50).all() and (plate[15:25, 10:20] < 130).all()


def test_a_body_that_is_lost_while_it_rests_still_covers_its_place():
    frames, covered, picture = resting_square(np.random.default_rng(4), leaves=8)
    covered[3:8] = False
    frames[3:8, 15:25, 10:20] += 4  # noise
    median = np.median(frames, axis=0).astype(np.uint8)
    np.testing.assert_array_equal(clear_plate(frames, covered, median)[0], picture)


def test_the_rim_of_a_body_is_no_background():
    frames, covered, picture = resting_square(np.random.default_rng(3), leaves=6)
    frames[:6, 15:25, 9] = 200  # half-covered pixels
    median = np.median(frames, axis=0).astype(np.uint8)
    assert MARGIN_PX >= 1
    np.testing.assert_array_equal(clear_plate(frames, covered, median)[0][15:25, 9], picture[15:25, 9])
