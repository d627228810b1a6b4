"""Tracks cut where bodies hit something."""

import numpy as np
import pytest

from pipeline.discovery.tracks.cutting import cut_tracks
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.track import Track

RADIUS, NOISE, RATE = 0.05, 0.002, 60
KNOWN = {"objects": [{"name": "ball", "shape": "sphere", "radius": RADIUS, "mass": 0.2}]}


def landing(rng: np.random.Generator, after: float) -> Track:
    """A ball that hits the ground so many steps before the last sample, at 3 to 9 m/s."""
    t = np.arange(60) / RATE
    contact, speed = t[-1] - after / RATE, rng.uniform(3, 9)
    since = t - contact
    rise = np.where(since < 0, -speed, rng.uniform(0.4, 0.8) * speed) * since - 4.905 * since**2
    level = rng.normal(0, 2, 2) * since[:, None]
    position = np.column_stack([level, RADIUS + rise]) + rng.normal(0, NOISE, (60, 3))
    return Track("clip_0", "ball", t, position)


@pytest.mark.parametrize("after", [6.5, 8.5, 20.5])
def test_samples_after_a_bounce_near_the_end_are_no_outliers(after: float, rng: np.random.Generator) -> None:
    for _ in range(6):
        track = landing(rng, after + rng.uniform(-0.4, 0.4))
        cut = cut_tracks([track], known_scene(KNOWN))
        assert not cut.outliers
        (impact,) = cut.impacts
        assert impact.other == -1 and impact.time == pytest.approx(track.time[-1] - after / RATE, abs=0.02)


@pytest.mark.parametrize("after", [1.5, 2.5, 3.5, 4.5, 5.5])
def test_no_arc_has_samples_from_both_sides_of_a_late_bounce(after: float, rng: np.random.Generator) -> None:
    for _ in range(6):
        track = landing(rng, after + rng.uniform(-0.4, 0.4))
        for arc in cut_tracks([track], known_scene(KNOWN)).arcs:
            falling = np.polynomial.Polynomial.fit(arc.time, arc.position[:, 2], 2)
            assert np.abs(arc.position[:, 2] - falling(arc.time)).max() < 5 * NOISE


def test_a_single_sample_that_is_off_is_an_outlier_wherever_it_is(rng: np.random.Generator) -> None:
    for row in (8, 30, 50):
        track = landing(rng, 20.5)
        track.position[row] += rng.choice([-1, 1], 3) * 0.1
        assert ("clip_0", 0, row) in cut_tracks([track], known_scene(KNOWN)).outliers


def test_samples_of_hops_of_seven_frames_are_no_outliers(rng: np.random.Generator) -> None:
    rate, hop, steps = 30, 7, 4
    t = np.arange(hop * steps) / rate
    since = t % (hop / rate) + 0.5 / rate
    height = 0.5 * 9.81 * since * (hop / rate - since + 0.5 / rate)
    position = np.column_stack([0.5 * t, 0 * t, RADIUS + np.abs(height)]) + rng.normal(0, 5e-4, (len(t), 3))
    sure = Track("clip_0", "ball", t, position, sigma=np.full(len(t), 5e-4))
    assert not cut_tracks([sure], known_scene(KNOWN)).outliers
