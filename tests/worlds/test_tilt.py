"""The turn of a camera that does not look straight at the plane of motion."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at
from pipeline.scene.scene import Scene, SceneObject
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.worlds.find_planar_scene import PlanarAnswer, find_planar_scene, measure_motion
from pipeline.worlds.plane import Plane
from pipeline.worlds.scale import Scale
from pipeline.worlds.tilt import Tilt

UPRIGHT = Plane(240, 960, px_per_m=400.0)  # 2.4 m high
TIMES = np.arange(68) / 120  # of whole steps of the simulation
ENDS = np.array([[120.0, 60.0], [120.0, 900.0]])


def turned(plane: Plane, pitch_deg: float, yaw_deg: float = 0.0) -> Plane:
    tilt = Tilt(np.radians(pitch_deg), np.radians(yaw_deg), plane.focal, (plane.width / 2, plane.height / 2))
    return replace(plane, tilt=tilt)


def fall(plane: Plane) -> tuple[PlanarAnswer, float]:
    """What is found of a ball that falls past two marks of known distance, and the IoU of its replay."""
    assert plane.tilt is not None
    ball = SceneObject("sphere", (0.03,), 0.5, position=(0.05, 0.0, 1.0), velocity=(-0.1, 0, -0.6))
    masks = masks_at(Scene((ball,), plane.camera(), (0, 0, -9.81), ground=None), TIMES, plane.width, plane.height)
    frames = np.where(masks[..., None] > 0, np.uint8(200), np.uint8(60)).repeat(3, -1)
    apart = np.linalg.norm(np.diff(plane.to_world(plane.tilt.straight(ENDS)), axis=0))
    scale = Scale(float((ENDS[1, 1] - ENDS[0, 1]) / apart), "length", 0.01, ENDS)
    answer = find_planar_scene(measure_motion(masks, frames, TIMES, view="flight", scale=scale))
    own = masks_at(answer.scene, TIMES, plane.width, plane.height)
    return answer, overlap(own, masks, 1, 1).sequence


@pytest.mark.parametrize("pitch_deg", [-7.0, 0.0, 5.0])
def test_a_fall_seen_by_a_pitched_camera_gives_gravity_within_a_percent(pitch_deg: float) -> None:
    answer, iou = fall(turned(UPRIGHT, pitch_deg))
    tilt = answer.motion.plane.tilt
    assert np.degrees(0.0 if tilt is None else tilt.pitch) == pytest.approx(pitch_deg, abs=1.0)
    assert -answer.scene.gravity[2] == pytest.approx(9.81, rel=0.01)
    assert iou > 0.9


def test_the_camera_sees_what_the_homography_says() -> None:
    plane = turned(replace(UPRIGHT, roll=0.1), 6.0, -4.0)
    assert plane.tilt is not None
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 2))
    seen, _ = project(plane.in_space(places), pinhole(plane.camera()), plane.width, plane.height)
    assert plane.tilt.straight(seen) == pytest.approx(plane.to_picture(places), abs=0.01)


def test_growth_is_the_root_of_the_homographys_determinant() -> None:
    tilt = turned(UPRIGHT, 6.0, -4.0).tilt
    assert tilt is not None
    at, step = np.array([30.0, 700.0]), 1e-3
    columns = [(tilt.straight(at + step * e) - tilt.straight(at - step * e)) / (2 * step) for e in np.eye(2)]
    assert tilt.growth(at) ** 2 == pytest.approx(np.linalg.det(np.stack(columns, 1)), rel=1e-5)


def test_a_small_motion_tells_no_turn() -> None:
    plane = turned(UPRIGHT, 5.0)
    ball = SceneObject("sphere", (0.03,), 0.5, position=(0.0, 0.0, 0.1), velocity=(0.2, 0, 0.5))
    times = TIMES[:16]
    masks = masks_at(Scene((ball,), plane.camera(), ground=None), times, plane.width, plane.height)
    frames = np.where(masks[..., None] > 0, np.uint8(200), np.uint8(60)).repeat(3, -1)
    assert measure_motion(masks, frames, times, view="flight").plane.tilt is None
