"""The view that tracks tell of, from tracks whose world is known."""

import numpy as np
import pytest

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc, cut_arcs
from pipeline.worlds.upright import camera_roll
from pipeline.worlds.view import View, find_view

TIMES = np.arange(30) / 30


def track_of(centre: np.ndarray, body: int = 1, radius: np.ndarray | float = 8.0, noise: float = 0.1) -> ImageTrack:
    """A disc's track with centres (T, 2) px and a radius, px, or one for each frame."""
    rng = np.random.default_rng(body)
    count = len(centre)
    radii = np.broadcast_to(radius, count).astype(float)
    return ImageTrack(
        body=body,
        frames=np.arange(count),
        times=TIMES[:count],
        centre=centre + rng.normal(0, noise, centre.shape),
        axes=np.stack([radii, radii], 1),
        angle=np.zeros(count),
        area=np.pi * radii**2,
        whole=np.ones(count, bool),
        sigma=noise,
    )


def view_of(*tracks: ImageTrack, roll_deg: float = 0.0) -> View:
    return find_view(tracks, [cut_arcs(t) for t in tracks], roll_deg)


def parabola(velocity: tuple[float, float], gravity: tuple[float, float]) -> np.ndarray:
    t = TIMES[:, None]
    return np.array([100.0, 150.0]) + t * velocity + 0.5 * t**2 * gravity


def test_a_throw_is_a_flight_and_tells_gravity_and_roll() -> None:
    view = view_of(track_of(parabola((150, -200), (-20, 400))))
    assert view.kind == "flight"
    assert view.gravity_px == pytest.approx([-20, 400], abs=4)
    assert view.roll_deg == pytest.approx(np.degrees(np.arctan2(20, 400)), abs=0.6)


def test_a_ball_that_rolls_and_then_falls_is_seen_from_the_side() -> None:
    t = TIMES[:, None]
    fall = np.where(t < 0.5, 0, 0.5 * 500 * (t - 0.5) ** 2)
    view = view_of(track_of(np.concatenate([50 + 200 * t, 100 + fall], 1)))
    assert view.kind == "side"
    assert [m.kind for m in view.arcs] == ["straight", "free"]


@pytest.mark.parametrize("slope_deg", [-35.0, -8.0, 12.0, 45.0])
@pytest.mark.parametrize("roll_deg", [0.0, 3.0])
def test_what_speeds_up_downhill_along_a_line_is_on_an_incline(slope_deg: float, roll_deg: float) -> None:
    angle = np.radians(slope_deg + roll_deg)
    way = np.array([np.cos(angle), np.sin(angle)]) * np.sign(slope_deg)
    along = 20 * TIMES + 0.5 * 250 * TIMES**2
    view = view_of(track_of(np.array([300.0, 100.0]) + along[:, None] * way), roll_deg=roll_deg)
    assert view.kind == "incline"
    assert view.slope_deg == pytest.approx(slope_deg, abs=0.5)


def arc_of(start: int, stop: int, velocity: list[float], acceleration: list[float], sigma: float) -> Arc:
    """An arc of a body from a frame to another one, with the standard error of its acceleration, px/s²."""
    bend, time, span = np.array(acceleration), 0.5 * (TIMES[start] + TIMES[stop - 1]), TIMES[stop - 1] - TIMES[start]
    return Arc(
        body=1,
        start=start,
        stop=stop,
        time=float(time),
        span=float(span),
        position=np.array([60.0, 20.0]) + 950 * time**2 * np.array([0.73, 0.68]),
        velocity=np.array(velocity),
        acceleration=bend,
        covariance=np.diag([1.0, 1.0, sigma**2]),
        rms=0.8,
        bend=bend,
    )


def test_a_ramp_stays_one_where_outlines_bend_parts_of_the_way() -> None:
    way = 950 * TIMES[:23, None] ** 2 * np.array([0.73, 0.68])
    arcs = [
        arc_of(0, 12, [251, 257], [1218, 1248], 39),
        arc_of(12, 16, [630, 633], [985, 827], 709),
        arc_of(16, 23, [853, 860], [955, 2115], 198),
    ]
    view = find_view([track_of(np.array([60.0, 20.0]) + way, radius=26.0)], [arcs])
    assert view.kind == "incline"
    assert [m.kind for m in view.arcs] == ["slope"] * 3
    assert view.slope_deg == pytest.approx(43, abs=3)


def test_straight_ways_in_several_directions_are_seen_from_above() -> None:
    t = TIMES[:, None]
    view = view_of(track_of(50 + t * [200.0, 10.0]), track_of(np.array([200.0, 20.0]) + t * [-30.0, 150.0], 2))
    assert view.kind == "top"


def test_bodies_that_grow_as_they_come_lower_are_on_a_table() -> None:
    t = TIMES[:, None]
    view = view_of(track_of(50 + t * [40.0, 150.0], radius=8 * np.exp(0.4 * TIMES)))
    assert view.kind == "table"


def test_bodies_at_rest_tell_nothing() -> None:
    assert view_of(track_of(np.full((30, 2), 90.0))).kind == "table"


def lines(roll_deg: float) -> np.ndarray:
    """A grey picture (H, W, 3) of a wall of tiles, turned by roll_deg clockwise."""
    y, x = np.mgrid[:240, :320].astype(float)
    angle = np.radians(roll_deg)
    u, v = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    joints = ((u % 40) < 3) | ((v % 40) < 3)
    return np.repeat(np.where(joints, 60, 190)[..., None], 3, 2).astype(np.uint8)


@pytest.mark.parametrize("roll_deg", [-4.0, 0.0, 2.5])
def test_upright_lines_tell_the_cameras_roll(roll_deg: float) -> None:
    assert camera_roll(lines(roll_deg)) == pytest.approx(roll_deg, abs=0.4)


def test_noise_tells_no_roll() -> None:
    rng = np.random.default_rng(0)
    assert camera_roll(rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)) is None


def test_what_goes_at_constant_speed_along_a_line_seen_from_the_side_goes_along_a_level_line() -> None:
    tracks = [track_of(np.array([40.0, 100.0]) + TIMES[:, None] * [150.0, 150.0 * np.tan(np.radians(3.5))])]
    arcs = [cut_arcs(t) for t in tracks]
    assert find_view(tracks, arcs).kind == "side"
    assert find_view(tracks, arcs).roll_deg == pytest.approx(3.5, abs=0.1)
    assert find_view(tracks, arcs, 0.0).roll_deg == 0.0  # where the camera's roll is known


def test_a_short_fall_tells_the_roll_less_than_a_long_one() -> None:
    fallen = parabola((120.0, -200.0), (-40.0, 400.0))  # of a camera that is rolled by 5.7 degrees
    rolls = []
    for count in (6, 30):
        track = track_of(fallen[:count])
        rolls.append(find_view([track], [cut_arcs(track)], kind="side").roll_deg)
    assert rolls[1] == pytest.approx(5.7, abs=0.5)
    assert abs(rolls[0]) < rolls[1]
