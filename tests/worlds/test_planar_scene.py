"""Planar scenes found from the masks and pictures of scenes that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import FixedBody, Joint, Scene, SceneObject
from pipeline.worlds.arcs import Arc
from pipeline.worlds.collisions import find_collisions
from pipeline.worlds.find_planar_scene import PlanarAnswer, find_planar_scene, measure_motion, scaled
from pipeline.worlds.planar_scene import sliding_friction
from pipeline.worlds.plane import Plane
from pipeline.worlds.scale import Scale

SCHEDULE = Schedule()
TIMES = np.arange(SCHEDULE.frames) / SCHEDULE.fps
SIDE = Plane(480, 320, px_per_m=200.0)


def found(scene: Scene, px_per_m: float | None = None) -> tuple[PlanarAnswer, float]:
    """What is found in a scene's clip, and the sequence IoU of its replay."""
    shown = replay_poses(scene, SCHEDULE)
    scale = None if px_per_m is None else Scale(px_per_m, "length", 0.01)
    motion = measure_motion(shown.masks, shown.pictures("raycast"), TIMES, scale=scale)
    answer = find_planar_scene(motion)
    own = masks_at(answer.scene, TIMES, 480, 320)
    return answer, overlap(own, shown.masks, len(answer.scene.objects), len(scene.objects)).sequence


def ball(**changes: object) -> SceneObject:
    return replace(
        SceneObject(shape="sphere", size=(0.08,), mass=0.5, sliding_friction=0.5, rolling_friction=0.0, damping=0.3),
        **changes,
    )  # type: ignore[arg-type]


def ramp(angle_deg: float) -> FixedBody:
    """A ramp through the picture's centre that descends to the right."""
    turn = Rotation.from_euler("y", angle_deg, degrees=True)
    centre = turn.apply([0.0, 0.0, -0.1])
    return FixedBody("box", (3.0, 0.6, 0.2), tuple(centre), tuple(turn.as_quat(scalar_first=True)))


@pytest.mark.parametrize("roll_deg", [0.0, 4.0])
def test_a_throw(roll_deg: float) -> None:
    plane = replace(SIDE, roll=-np.radians(roll_deg))
    thrown = ball(position=(-0.8, 0, -0.2), velocity=(1.6, 0, 3.0))
    answer, iou = found(Scene((thrown,), plane.camera(), ground=None))
    assert answer.motion.view.kind == "flight"
    assert answer.scene.composition == "sphere"
    assert answer.scale.by == "gravity"
    assert answer.scale.px_per_m == pytest.approx(200, rel=0.02)
    assert answer.motion.view.roll_deg == pytest.approx(roll_deg, abs=0.6)
    assert answer.scene.objects[0].velocity == pytest.approx(thrown.velocity, abs=0.06)
    assert iou > 0.9


def test_gravity_is_measured_where_a_length_is_known() -> None:
    thrown = ball(position=(-0.8, 0, -0.2), velocity=(1.6, 0, 2.0))
    answer, _ = found(Scene((thrown,), SIDE.camera(), (0, 0, -6.0), ground=None), px_per_m=200.0)
    assert answer.scale.by == "length"
    assert -answer.scene.gravity[2] == pytest.approx(6.0, rel=0.02)


def test_a_ball_that_rolls_down_a_ramp() -> None:
    turn = Rotation.from_euler("y", 15, degrees=True)
    start = turn.apply([-0.9, 0, 0.0801])
    rolling = ball(position=tuple(start), sliding_friction=0.8)
    answer, iou = found(Scene((rolling,), SIDE.camera(), ground=None, fixed=(ramp(15),)))
    assert answer.motion.view.kind == "incline"
    (support,) = answer.scene.fixed
    angle = Rotation.from_quat(support.orientation, scalar_first=True).as_euler("yxz", degrees=True)[0]
    assert angle == pytest.approx(15, abs=0.7)
    assert answer.scale.px_per_m == pytest.approx(200, rel=0.06)
    assert iou > 0.85


def test_how_hollow_a_pipe_is_shows_where_a_length_is_known() -> None:
    turn = Rotation.from_euler("y", 15, degrees=True)
    axis = Rotation.from_euler("x", -90, degrees=True).as_quat(scalar_first=True)
    hollows = {}
    for hollow in (0.0, 0.9):
        pipe = SceneObject(
            "cylinder",
            (0.08, 0.08),
            0.5,
            0.8,
            position=tuple(turn.apply([-0.9, 0, 0.0801])),
            orientation=tuple(axis),
            hollow=hollow,
        )
        answer, _ = found(Scene((pipe,), SIDE.camera(), ground=None, fixed=(ramp(15),)), px_per_m=200.0)
        assert answer.scene.composition == "cylinder"
        hollows[hollow] = answer.scene.objects[0].hollow
    assert hollows[0.0] < 0.5
    assert hollows[0.9] == pytest.approx(0.9, abs=0.1)


def test_a_ball_that_rolls_over_an_edge_falls_behind_it() -> None:
    table = FixedBody("box", (1.6, 0.6, 0.2), (-0.8, 0.27, 0.3))
    spin = (0.0, 1.5 / 0.08, 0.0)
    rolling = ball(position=(-0.7, 0, 0.4801), velocity=(1.5, 0, 0), angular_velocity=spin)
    answer, iou = found(Scene((rolling,), SIDE.camera(), ground=None, fixed=(table,)))
    assert answer.motion.view.kind == "side"
    assert len(answer.scene.fixed) == 1
    assert answer.scale.px_per_m == pytest.approx(200, rel=0.03)
    assert iou > 0.85


def test_a_ball_that_bounces_tells_of_the_floor() -> None:
    floor = FixedBody("box", (3.0, 0.6, 0.2), (0.0, 0.0, -0.7))
    falling = ball(position=(-0.5, 0, 0.4), velocity=(0.8, 0, 0))
    answer, iou = found(Scene((falling,), SIDE.camera(), ground=None, fixed=(floor,)))
    (support,) = answer.motion.supports
    assert support.start[1] == pytest.approx(160 + 0.6 * 200, abs=6)  # contacts are soft: the ball sinks in
    assert support.restitution is not None
    assert iou > 0.8


def test_a_ball_that_bounces_twice_is_followed_through_both_bounces() -> None:
    floor = FixedBody("box", (3.0, 0.6, 0.2), (0.0, 0.0, -0.7), damping=0.1)
    falling = ball(position=(-0.8, 0, 0.0), velocity=(1.2, 0, -0.5))
    answer, iou = found(Scene((falling,), SIDE.camera(), ground=None, fixed=(floor,)))
    assert all(b.damping is not None for b in answer.scene.fixed)
    assert answer.fit.rms_px < 8
    assert iou > 0.7


def test_a_body_that_slides_off_an_incline_is_still_on_an_incline() -> None:
    turn = Rotation.from_euler("y", 25, degrees=True)
    start = turn.apply([-0.75, 0, 0.0601])
    box = SceneObject(
        "box", (0.2, 0.15, 0.12), 0.5, 0.05, position=tuple(start), orientation=tuple(turn.as_quat(scalar_first=True))
    )
    short = replace(ramp(25), size=(1.7, 0.6, 0.2))
    answer, iou = found(Scene((box,), SIDE.camera(), ground=None, fixed=(short,)))
    assert answer.motion.view.kind == "incline"
    assert abs(answer.motion.view.slope_deg) == pytest.approx(25, abs=1.5)
    assert iou > 0.8


@pytest.mark.parametrize("speed", [1.6, -0.1])
def test_friction_brakes_what_slides_up_an_incline_and_what_slides_down(speed: float) -> None:
    slope, friction, gravity = np.radians(20.0), 0.2, 9.81
    way = np.array([np.cos(slope), np.sin(slope)])  # down, in the picture
    pull = gravity * (np.sin(slope) + np.sign(speed) * friction * np.cos(slope))
    arc = Arc(1, 0, 9, 0.1, 0.2, np.zeros(2), -200 * speed * way, 200 * pull * way, np.eye(3), 0.1, 200 * pull * way)
    assert sliding_friction(arc, 20.0, SIDE, gravity) == pytest.approx(friction)


def test_pucks_that_collide_tell_their_masses() -> None:
    def puck(x: float, vx: float, mass: float) -> SceneObject:
        return SceneObject(
            shape="cylinder",
            size=(0.1, 0.06),
            mass=mass,
            sliding_friction=0.002,
            rolling_friction=0,
            damping=0.1,
            position=(x, 0.02 * vx, 0.03),
            velocity=(vx, 0, 0),
        )

    plane = Plane(480, 320, 200.0, level=True)
    scene = Scene((puck(-0.6, 1.2, 1.0), puck(0.2, 0.0, 1.5)), plane.camera())
    answer, iou = found(scene)
    assert answer.motion.view.kind == "top"
    assert answer.scale.by == "none"
    (hit,) = find_collisions(answer.motion.tracks, answer.motion.arcs)
    assert hit.mass_ratio == pytest.approx(1.5, rel=0.1)
    assert iou > 0.85


def test_a_scaled_scene_looks_the_same() -> None:
    scene = Scene((ball(position=(-0.5, 0, 0.2), velocity=(1, 0, 1)),), SIDE.camera(), ground=-0.6)
    masks = masks_at(scene, TIMES, 240, 160)
    larger = masks_at(scaled(scene, 2.5), TIMES, 240, 160)
    assert overlap(masks, larger, 1, 1).sequence > 0.97


def pendulum(arm: float, angle: float, damping: float) -> Scene:
    """A ball on a rod that starts at rest, seen from the side; its anchor is above the picture."""
    anchor = np.array([0.1, 0.0, 0.9])
    place = anchor + arm * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    hung = ball(position=tuple(place), joint=Joint("rod", tuple(anchor), damping=damping))
    return Scene((hung,), SIDE.camera(), ground=None)


def test_a_ball_on_a_rod_hangs_and_its_length_follows_from_gravity(rng: np.random.Generator) -> None:
    arm, angle, damping = rng.uniform(0.5, 0.75), rng.uniform(0.5, 0.8), rng.uniform(0.02, 0.2)
    answer, iou = found(pendulum(arm, angle, damping))
    assert answer.motion.view.kind == "hanging"
    (hung,) = answer.scene.objects
    assert hung.joint is not None
    assert hung.joint.kind == "rod"
    assert np.linalg.norm(np.subtract(hung.position, hung.joint.anchor)) == pytest.approx(arm, rel=0.05)
    assert hung.joint.anchor[:3:2] == pytest.approx((0.1, 0.9), abs=0.06)
    assert iou > 0.9


def test_gravity_follows_from_a_known_length_where_bodies_hang(rng: np.random.Generator) -> None:
    gravity = rng.uniform(6.0, 12.0)
    scene = replace(pendulum(0.5, 0.7, 0.05), gravity=(0.0, 0.0, -gravity))
    answer, iou = found(scene, px_per_m=200.0)
    assert answer.motion.view.kind == "hanging"
    assert answer.scene.gravity[2] == pytest.approx(-gravity, rel=0.06)
    assert iou > 0.9
