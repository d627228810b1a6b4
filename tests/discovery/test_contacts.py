"""Collisions show in the distance between two bodies, however weak the blow."""

import numpy as np
import pytest

from pipeline.discovery.tracks.contacts import closest_approaches, ground_may_push
from pipeline.discovery.tracks.velocity_jumps import VelocityJump

SIGMA = 0.002


@pytest.mark.parametrize("speed", [0.8, 1.5, 3.0])
def test_a_distance_that_stops_shrinking_at_touch_is_a_collision(speed: float, rng: np.random.Generator) -> None:
    time, touch, when = np.arange(60) / 60, 0.1, float(rng.uniform(0.3, 0.7))
    for after in (0.9, 0.4):
        distance = touch + speed * np.where(time < when, when - time, after * (time - when))
        found = closest_approaches(time, distance + rng.normal(0, 1.4 * SIGMA, 60), touch, SIGMA)
        assert len(found) >= 1 and min(abs(t - when) for t in found) < 2.5 / 60


def test_balls_that_pass_at_a_distance_do_not_collide(rng: np.random.Generator) -> None:
    time = np.arange(60) / 60
    distance = np.hypot(0.2, 1.5 * (time - 0.5)) + rng.normal(0, 1.4 * SIGMA, 60)
    assert closest_approaches(time, distance, 0.1, SIGMA) == []


@pytest.mark.parametrize(
    ("change", "may"), [((0.1, 0.0, 2.0), True), ((0.8, 0.3, 1.0), True), ((1.0, 0.4, 0.02), False)]
)
def test_the_ground_pushes_upwards_and_sideways_by_friction_alone(change: tuple[float, ...], may: bool) -> None:
    assert ground_may_push(VelocityJump(0.5, np.zeros(3), np.array(change), 30.0)) is may
