"""The likelihood of views, from arcs and sizes of worlds that are known."""

import numpy as np
import pytest

from pipeline.worlds.view_evidence import Growth, Moving, explanations

FOCAL = 400.0
STILL = Growth(0.0, 1e-4, 100.0, 0.0)


def arcs(*rows: tuple[float, float, float, float], sigma: float = 20.0) -> Moving:
    """Arcs of half a second with velocity and acceleration (x, y), px/s and px/s²."""
    table = np.array(rows)
    velocity, acceleration = table[:, :2], table[:, 2:]
    slope = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
    slope = (slope + 90) % 180 - 90
    count = len(table)
    path = 0.5 * np.linalg.norm(velocity, axis=1)
    return Moving(velocity, acceleration, np.full(count, sigma), path, slope, np.full(count, 0.5), np.full(count, 15.0))


def likeliest(moving: Moving, growth: Growth = STILL) -> str:
    return next(iter(explanations(moving, growth, 0.0, 1.0, FOCAL)))


def test_straight_ways_in_many_directions_are_seen_from_above() -> None:
    assert likeliest(arcs((200, 80, 0, 0), (-100, 150, 0, 0), (60, -180, -10, 30))) == "top"


def test_one_fall_among_level_ways_is_seen_from_the_side() -> None:
    assert likeliest(arcs((200, 0, 0, 0), (180, 2, 0, 0), (170, 200, 0, 1500))) == "side"


def test_throws_with_one_acceleration_fly() -> None:
    assert likeliest(arcs((200, -100, 0, 1500), (-80, 300, 10, 1480))) == "flight"


@pytest.mark.parametrize("turned", [20.0, -35.0])
def test_what_speeds_up_along_a_line_is_on_an_incline(turned: float) -> None:
    angle = np.radians(turned)
    way = np.array([np.cos(angle), np.sin(angle)]) * np.sign(turned)
    assert likeliest(arcs((*(200 * way), *(500 * way)))) == "incline"


def test_what_speeds_up_as_perspective_has_it_is_on_a_table() -> None:
    cot, velocity = 1.7, np.array([40.0, 150.0])
    slope = cot / FOCAL  # of the logarithm of the radius
    speeds_up = 2 * slope * velocity[1] * velocity
    grows = Growth(slope, 1e-4, 75.0, 0.0)
    assert likeliest(arcs((*velocity, *speeds_up)), grows) == "table"


def test_an_arc_that_no_view_explains_costs_no_more_than_an_outlier() -> None:
    steady = [(200, 80, 0, 0), (-100, 150, 0, 0), (60, -180, 0, 0), (90, 140, 0, 0)]
    assert likeliest(arcs(*steady, (10, 10, 3000, -9000))) == "top"


def test_each_arc_is_what_costs_least_in_a_view() -> None:
    moving = arcs((200, 0, 0, 0), (180, 2, 0, 0), (170, 200, 0, 1500), (10, 10, 3000, -9000))
    assert explanations(moving, STILL, 0.0, 1.0, FOCAL)["side"].kinds == ("straight", "straight", "free", "other")


def test_a_flight_needs_a_fall_and_an_incline_a_line() -> None:
    found = explanations(arcs((200, 0, 0, 0)), STILL, 0.0, 1.0, FOCAL)
    assert "flight" not in found
    assert "incline" not in found
