"""Tracks and arcs of discs whose motion in the picture is known."""

import numpy as np
import pytest

from pipeline.bodies.tracks.image_track import centre_sigma, image_tracks
from pipeline.worlds.arcs import cut_arcs

WIDTH, HEIGHT = 160, 120


def drawn_disc(centres: np.ndarray, radius: float) -> np.ndarray:
    """Masks (T, HEIGHT, WIDTH) of a disc with centres (T, 2) px."""
    x, y = np.arange(WIDTH) + 0.5, np.arange(HEIGHT)[:, None] + 0.5
    return np.stack([((x - cx) ** 2 + (y - cy) ** 2 <= radius**2).astype(np.uint8) for cx, cy in centres])


def test_a_track_has_the_discs_centre_and_radius() -> None:
    times = np.arange(20) / 30
    centres = np.stack([40.0 + 60 * times, 50.0 + 20 * times], 1)
    (track,) = image_tracks(drawn_disc(centres, 9.0), times)
    assert np.abs(track.centre - centres).max() < 0.15
    assert track.radius == pytest.approx(9.0, abs=0.1)
    assert np.allclose(track.axes, 9.0, atol=0.3)
    assert track.whole.all()


def test_the_centre_of_a_disc_that_the_border_cuts_is_found_from_its_edge() -> None:
    times = np.arange(20) / 30
    centres = np.stack([-2.0 + 60 * times, np.full(20, 60.0)], 1)
    (track,) = image_tracks(drawn_disc(centres, 9.0), times)
    seen = track.centre[track.whole]
    assert track.whole[track.frames >= 5].all()
    assert np.abs(seen - centres[track.frames[track.whole]]).max() < 0.6


def test_free_fall_is_one_arc_with_its_acceleration() -> None:
    times = np.arange(24) / 30
    centres = np.stack([30.0 + 100 * times, 20.0 - 20 * times + 0.5 * 250 * times**2], 1)
    (track,) = image_tracks(drawn_disc(centres, 6.0), times)
    (arc,) = cut_arcs(track)
    assert arc.acceleration == pytest.approx([0, 250], abs=5)
    assert arc.velocity_at(0.0) == pytest.approx([100, -20], abs=3)


def test_a_bounce_cuts_a_track_where_it_happens() -> None:
    times = np.arange(30) / 30
    hit = 0.5
    down = 20 + 120 * times
    centres = np.stack([30 + 80 * times, np.where(times < hit, down, 80 - 70 * (times - hit))], 1)
    (track,) = image_tracks(drawn_disc(centres, 6.0), times)
    first, second = cut_arcs(track)
    assert abs(track.times[second.start] - hit) <= 1 / 30 + 1e-9
    assert first.velocity == pytest.approx([80, 120], abs=3)
    assert second.velocity == pytest.approx([80, -70], abs=3)
    assert not first.acceleration.any() and not second.acceleration.any()


def test_an_impact_that_a_few_frames_show_is_no_arc() -> None:
    """A cart on a magnet: the turn takes four frames, in which the acceleration is fifteen times that of the slope."""
    times = np.arange(45) / 30
    rate, slope, turn = 600, 100.0, 0.14
    fine = np.arange(int(times[-1] * rate) + 1) / rate
    pull = np.where(np.abs(fine - 0.4) < turn / 2, 15 * slope, -slope)
    velocity = -40 + np.cumsum(pull) / rate
    place = 60 + np.cumsum(velocity) / rate
    along = np.interp(times, fine, place)
    (track,) = image_tracks(drawn_disc(np.stack([along, np.full(len(times), 60.0)], 1), 8.0), times)
    arcs = cut_arcs(track)
    assert len(arcs) == 2
    for arc in arcs:
        assert arc.acceleration[0] == pytest.approx(-slope, rel=0.2)


def test_single_bad_outlines_do_not_cut_a_track() -> None:
    times = np.arange(30) / 30
    centres = np.stack([30 + 80 * times, 40 + 20 * times], 1)
    moved = centres.copy()
    moved[[7, 19]] += [9, -8]
    (track,) = image_tracks(drawn_disc(moved, 6.0), times)
    (arc,) = cut_arcs(track)
    assert arc.velocity == pytest.approx([80, 20], abs=2)


def test_the_noise_of_centres_is_found_beside_an_impact() -> None:
    rng = np.random.default_rng(3)
    times = np.arange(400) / 30
    path = np.stack([40 * times, np.abs(100 - 30 * times)], 1)
    assert centre_sigma(path + rng.normal(0, 0.4, path.shape)) == pytest.approx(0.4, rel=0.25)
