"""Every kind of event against a scene whose motion has a formula."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.clips.events import (
    DEFAULT_THRESHOLDS,
    KINDS,
    ROLL,
    SLIDE,
    Event,
    Thresholds,
    find_events,
    regimes,
    visibility,
)
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import areas_px, frame_masks
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Camera, Scene, SceneObject

G = 9.81
STEP = 1 / 240
SCHEDULE = Schedule()
THRESHOLDS = DEFAULT_THRESHOLDS


def sphere(**values: object) -> SceneObject:
    return replace(SceneObject("sphere", (0.1,), 1.0, position=(0, 0, 0.1)), **values)  # type: ignore[arg-type]


def box(**values: object) -> SceneObject:
    flat = SceneObject("box", (0.3, 0.3, 0.06), 1.0, position=(0, 0, 0.03))
    return replace(flat, **values)  # type: ignore[arg-type]


def run(*objects: SceneObject, gravity: float = G, ground: float | None = 0.0, seconds: float = 1.0) -> Trace:
    return simulate(Scene(objects, gravity=(0, 0, -gravity), ground=ground), seconds)


def events(
    trace: Trace, *shapes: str, thresholds: Thresholds = THRESHOLDS, areas: np.ndarray | None = None
) -> list[Event]:
    """The events of a trace whose objects are in view all the time unless `areas` says otherwise."""
    steps = np.arange(0, len(trace.position) - 1, 8)
    areas = np.full((len(steps), len(shapes)), 1000.0) if areas is None else areas
    return find_events(trace, shapes, areas, steps, thresholds)


def told(found: list[Event]) -> list[tuple[str, int, int | None]]:
    return [(e.kind, e.first, e.second) for e in found]


@pytest.mark.parametrize("gravity", [1.62, 9.81])
def test_a_ball_dropped_from_h_lands_at_sqrt_2h_over_g(rng: np.random.Generator, gravity: float) -> None:
    h = rng.uniform(0.1, 0.4)
    found = events(run(sphere(position=(0, 0, 0.1 + h), damping=1.0), gravity=gravity), "sphere")
    assert told(found) == [("hits_ground", 0, None)]
    # MuJoCo's semi-implicit steps fall ahead of the parabola by half a step
    assert found[0].time == pytest.approx(np.sqrt(2 * h / gravity), abs=1.5 * STEP)


def test_a_ball_thrown_up_comes_back_after_2v_over_g(rng: np.random.Generator) -> None:
    v = rng.uniform(1, 3)
    found = events(run(sphere(velocity=(0, 0, v))), "sphere")
    assert found[0].kind == "hits_ground"
    assert found[0].time == pytest.approx(2 * v / G, abs=1.5 * STEP)


def test_a_box_slides_v2_over_2_mu_g_and_stops_at_v_over_mu_g(rng: np.random.Generator) -> None:
    v, mu = rng.uniform(0.8, 1.5), rng.uniform(0.25, 0.5)
    trace = run(box(velocity=(v, 0, 0), sliding_friction=mu))
    found = events(trace, "box")
    assert told(found) == [("stops_sliding", 0, None)]
    # it counts as at rest below `moving_speed`; soft contacts, and its settling at the start, make 6 % of the rest
    assert found[0].time == pytest.approx((v - THRESHOLDS.moving_speed) / (mu * G), rel=0.06, abs=2 * STEP)
    assert trace.position[-1, 0, 0] == pytest.approx(v * v / (2 * mu * G), rel=0.05)


def test_a_ball_that_slides_rolls_from_two_sevenths_of_v_over_mu_g_on(rng: np.random.Generator) -> None:
    v, mu = rng.uniform(0.8, 1.5), rng.uniform(0.15, 0.3)
    trace = run(sphere(velocity=(v, 0, 0), sliding_friction=mu))
    found = events(trace, "sphere")
    assert told(found) == [("starts_rolling", 0, None)]
    assert found[0].time == pytest.approx(2 / 7 * v / (mu * G), abs=0.04)  # slip is a mean over 0.05 s
    assert trace.velocity[-1, 0, 0] == pytest.approx(5 / 7 * v, rel=0.02)


def test_rolling_friction_c_stops_a_ball_at_seven_fifths_of_v_r_over_c_g(rng: np.random.Generator) -> None:
    v, c, r = rng.uniform(0.3, 0.5), rng.uniform(0.02, 0.03), 0.1
    trace = run(sphere(velocity=(v, 0, 0), angular_velocity=(0, v / r, 0), rolling_friction=c, sliding_friction=1.0))
    found = events(trace, "sphere")
    assert told(found) == [("stops_rolling", 0, None)]
    stop = 1.4 * (v - THRESHOLDS.moving_speed) * r / (c * G)
    assert found[0].time == pytest.approx(stop, rel=0.1)


def test_a_rolling_ball_that_hits_an_equal_one_keeps_its_spin_and_starts_sliding(rng: np.random.Generator) -> None:
    gap = rng.uniform(0.2, 0.4)
    ball = sphere(velocity=(1, 0, 0), angular_velocity=(0, 10, 0), sliding_friction=0.08, damping=0.3)
    found = events(run(ball, sphere(position=(0.2 + gap, 0, 0.1), sliding_friction=0.08)), "sphere", "sphere")
    assert told(found)[0] == ("hits_object", 0, 1)
    assert set(told(found)[1:3]) == {("starts_sliding", 0, None), ("starts_sliding", 1, None)}
    assert found[0].time == pytest.approx(gap / 1.0, abs=2 * STEP)
    assert all(gap - 2 * STEP <= e.time < gap + 0.06 for e in found[1:3])


def test_two_balls_collide_when_their_gap_is_closed(rng: np.random.Generator) -> None:
    a, b = rng.uniform(0.3, 1.5, 2)
    gap = rng.uniform(0.2, 0.8) * (a + b)
    left = sphere(position=(-0.1, 0, 1), velocity=(a, 0, 0))
    right = sphere(position=(0.1 + gap, 0, 1), velocity=(-b, 0, 0))
    for pair in ((left, right), (right, left)):
        found = events(run(*pair, gravity=0, ground=None), "sphere", "sphere")
        assert told(found) == [("hits_object", 0, 1)]
        assert found[0].time == pytest.approx(gap / (a + b), abs=1.01 * STEP)


def passing_ball(speed: float, start: float) -> Scene:
    """A ball that flies along x past a camera that looks along y from 2 m."""
    ball = sphere(position=(start, 0, 1.0), velocity=(speed, 0, 0))
    return Scene((ball,), Camera((0, -2, 1), fov=40, pitch=0), (0, 0, 0), None)


def edge_of_view() -> float:
    """How far along x the ball is when the camera sees the last of it: the plane of the image's edge touches it."""
    angle = np.arctan(480 / 320 * np.tan(np.radians(20)))
    return float((0.1 + 2 * np.sin(angle)) / np.cos(angle))


def seen(scene: Scene) -> list[Event]:
    trace = simulate(scene)
    areas = areas_px(frame_masks(scene, trace, SCHEDULE, 480, 320), 1)
    return find_events(trace, scene.shapes, areas, SCHEDULE.frame_steps, THRESHOLDS)


def test_a_ball_leaves_the_view_when_it_has_passed_the_edge_of_the_image(rng: np.random.Generator) -> None:
    speed = rng.uniform(1.8, 2.5)
    (event,) = seen(passing_ball(speed, 0.0))
    assert event.kind == "leaves"
    # told at a frame, and from fewer than `visible_px` on
    assert edge_of_view() / speed - 0.05 < event.time < edge_of_view() / speed + 1.01 / 30


def test_a_ball_enters_the_view_when_it_comes_over_the_edge_of_the_image(rng: np.random.Generator) -> None:
    speed = rng.uniform(0.5, 1.0)
    start = -edge_of_view() - 0.3 * speed
    (event,) = seen(passing_ball(speed, start))
    assert event.kind == "enters"
    assert 0.3 < event.time < 0.3 + 0.05 + 1.01 / 30


def test_nothing_is_told_where_nothing_happens() -> None:
    assert events(run(sphere(), box(position=(1, 0, 0.03))), "sphere", "box") == []
    assert events(run(sphere(velocity=(1, 2, 0)), gravity=0, ground=None), "sphere") == []
    rolling = sphere(velocity=(1, 0, 0), angular_velocity=(0, 10, 0), sliding_friction=1.0)
    assert events(run(rolling), "sphere") == []


def test_an_upright_cylinder_that_slides_to_a_stop_never_rolls(rng: np.random.Generator) -> None:
    v = rng.uniform(0.3, 0.8)
    can = SceneObject("cylinder", (0.12, 0.1), 1.0, sliding_friction=0.15, position=(0, 0, 0.05), velocity=(v, 0, 0))
    assert told(events(run(can), "cylinder")) == [("stops_sliding", 0, None)]


def test_a_cylinder_on_its_side_rolls_and_a_box_tumbles() -> None:
    on_its_side = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    roll = SceneObject(
        "cylinder",
        (0.1, 0.3),
        1.0,
        sliding_friction=0.8,
        position=(0, 0, 0.1),
        velocity=(1, 0, 0),
        angular_velocity=(0, 10, 0),
        orientation=on_its_side,
    )
    table = regimes(run(roll), ("cylinder",), THRESHOLDS)
    assert set(table[:, 0]) == {ROLL}
    cube = box(size=(0.2, 0.2, 0.2), position=(0, 0, 0.1), velocity=(2.5, 0, 0), angular_velocity=(0, 15, 0))
    assert ROLL not in regimes(run(cube), ("box",), THRESHOLDS)


def test_a_box_that_chatters_over_the_ground_slides() -> None:
    chattering = box(
        size=(0.285, 0.276, 0.206),
        mass=0.33,
        sliding_friction=0.49,
        damping=0.3,
        position=(0, 0, 0.103),
        velocity=(-0.8, -1.06, 0),
        angular_velocity=(0, 0, 0.94),
    )
    trace = run(chattering)
    contacts = np.bincount(trace.contacts.step, minlength=240)
    assert (contacts[:100] == 0).mean() > 0.2, "it hops"
    found = events(trace, "box")
    assert told(found) == [("stops_sliding", 0, None)]
    assert found[0].time == pytest.approx(np.hypot(0.8, 1.06) / (0.49 * G), rel=0.4)
    assert set(regimes(trace, ("box",), THRESHOLDS)[:60, 0]) == {SLIDE}


@pytest.mark.parametrize(("threshold", "heard"), [(1.0, True), (4.0, False)])
def test_touches_softer_than_impact_speed_are_no_hits(threshold: float, heard: bool) -> None:
    trace = run(sphere(position=(0, 0, 0.1 + 0.3), damping=1.0))  # lands at 2.4 m/s
    found = events(trace, "sphere", thresholds=replace(THRESHOLDS, impact_speed=threshold))
    assert bool(found) == heard


def test_touches_closer_together_than_separation_are_one() -> None:
    trace = run(sphere(position=(0, 0, 0.2), damping=0.1))
    many = events(trace, "sphere", thresholds=replace(THRESHOLDS, separation=0.02, impact_speed=0.01))
    few = events(trace, "sphere", thresholds=replace(THRESHOLDS, separation=0.3, impact_speed=0.01))
    times = [e.time for e in many if e.kind == "hits_ground"]
    assert len(times) > 1
    assert len([e for e in few if e.kind == "hits_ground"]) < len(times)


def test_a_ball_slides_or_rolls_as_slip_speed_says() -> None:
    trace = run(sphere(velocity=(0.4, 0, 0), sliding_friction=0.02))  # slips at 0.4 - 3.5 mu g t, at the end 0.013 m/s
    strict, loose = replace(THRESHOLDS, slip_speed=0.02), replace(THRESHOLDS, slip_speed=0.15)
    (late,), (soon,) = events(trace, "sphere", thresholds=strict), events(trace, "sphere", thresholds=loose)
    assert (late.kind, soon.kind) == ("starts_rolling", "starts_rolling")
    assert late.time - soon.time > 0.05


def test_a_change_of_view_of_a_single_frame_is_not_told() -> None:
    areas = np.full((30, 1), 100.0)
    areas[10] = 0.0
    assert visibility(areas, np.arange(30) / 30, THRESHOLDS) == []
    areas[11] = 0.0
    found = visibility(areas, np.arange(30) / 30, THRESHOLDS)
    assert [(e.kind, round(e.time * 30)) for e in found] == [("leaves", 10), ("enters", 12)]


def test_an_object_counts_as_seen_from_visible_px_on() -> None:
    areas = np.array([[40.0], [40.0], [20.0], [20.0]])
    assert len(visibility(areas, np.arange(4) / 30, THRESHOLDS)) == 1
    assert visibility(areas, np.arange(4) / 30, replace(THRESHOLDS, visible_px=10)) == []


def test_what_happens_out_of_view_is_not_told() -> None:
    trace = run(sphere(position=(0, 0, 0.3)), sphere(position=(1, 0, 0.3)))
    areas = np.full((30, 2), 1000.0)
    areas[:, 1] = 0.0
    assert {e.first for e in events(trace, "sphere", "sphere", areas=areas)} == {0}


def test_the_earliest_events_are_kept_in_the_order_of_time() -> None:
    trace = run(*(sphere(position=(x, 0, 0.15 + 0.1 * x), damping=0.2) for x in range(5)))
    shapes = ("sphere",) * 5
    everything = events(trace, *shapes, thresholds=replace(THRESHOLDS, most=1000))
    assert [round(e.time, 2) for e in everything] == sorted(round(e.time, 2) for e in everything)
    assert len(everything) > 3
    assert events(trace, *shapes, thresholds=replace(THRESHOLDS, most=3)) == everything[:3]
    assert {e.kind for e in everything} <= set(KINDS)
