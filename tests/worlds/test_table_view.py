"""Balls on a table that is seen from above and aside."""

import numpy as np
import pytest

from pipeline.bodies.tracks.image_track import image_tracks
from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import FixedBody, Scene, SceneObject
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.worlds.find_planar_scene import find_planar_scene, measure_motion
from pipeline.worlds.plane import Plane
from pipeline.worlds.table_view import TableView, table_view
from pipeline.worlds.view_evidence import Growth

SCHEDULE = Schedule()
TIMES = np.arange(SCHEDULE.frames) / SCHEDULE.fps
PLANE = Plane(480, 320, px_per_m=200.0, level=True)
RADIUS = 0.1


def rolling(x: float, velocity: tuple[float, float]) -> SceneObject:
    vx, vy = velocity
    return SceneObject(
        shape="sphere",
        size=(RADIUS,),
        mass=0.5,
        sliding_friction=0.6,
        rolling_friction=0.0,
        damping=0.3,
        position=(x, 0.1, RADIUS),
        velocity=(vx, vy, 0),
        angular_velocity=(-vy / RADIUS, vx / RADIUS, 0),
    )


def test_places_on_the_table_are_those_of_its_camera() -> None:
    table = TableView(PLANE, 30.0, RADIUS)
    places = np.array([[0.3, 0.2, RADIUS], [-0.4, -0.3, RADIUS]])
    px, depths = project(places, pinhole(table.camera()), 480, 320)
    found, depth = table.to_ground(px, RADIUS)
    assert found == pytest.approx(places[:, :2], abs=1e-5)
    assert depth == pytest.approx(depths, rel=1e-5)


def test_growth_tells_how_steeply_the_camera_looks_down() -> None:
    table = TableView(PLANE, 30.0, RADIUS)
    focal = PLANE.distance * PLANE.px_per_m
    sure = Growth(float(1 / np.tan(np.radians(40)) / focal), 1e-5, 300.0, 0.0)
    track = image_tracks(replay_poses(Scene((rolling(-0.5, (1.0, 0.3)),), table.camera()), SCHEDULE).masks, TIMES)
    assert table_view(PLANE, sure, track).pitch_deg == pytest.approx(40, abs=2)
    assert table_view(PLANE, Growth(0.0, np.inf, 0.0, np.inf), track).pitch_deg == pytest.approx(30, abs=2)


def test_a_ball_that_turns_back_at_something_still_tells_of_a_wall() -> None:
    wall = FixedBody("box", (0.1, 0.6, 0.3), (0.45, 0.1, 0.15))
    scene = Scene((rolling(-0.6, (1.8, -0.1)),), TableView(PLANE, 30.0, RADIUS).camera(), fixed=(wall,))
    shown = replay_poses(scene, SCHEDULE)
    motion = measure_motion(shown.masks, shown.pictures("raycast"), TIMES, view="table")
    answer = find_planar_scene(motion)
    assert answer.scene.composition == "sphere"
    assert len(answer.scene.fixed) == 1
    assert overlap(masks_at(answer.scene, TIMES, 480, 320), shown.masks, 1, 1).sequence > 0.7
