"""Free rotation, and bodies whose rotation outlines show."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Scene, SceneObject
from pipeline.scene.solid import unit_inertia
from pipeline.worlds.find_planar_scene import find_planar_scene, measure_motion
from pipeline.worlds.plane import Plane
from pipeline.worlds.tumbling import free_rotation, free_rotation_through

SCHEDULE = Schedule()
TIMES = np.arange(SCHEDULE.frames) / SCHEDULE.fps
HALF = np.array([0.05, 0.08, 0.13])


def test_a_free_rotation_keeps_energy_and_angular_momentum() -> None:
    inertia = unit_inertia("box", HALF[None], np.zeros(1))[0]
    spin = np.array([1.0, 6.0, 2.0])
    first = Rotation.from_rotvec([0.3, -0.2, 0.5])
    step = 1e-3
    path = free_rotation(inertia, first, spin, np.array([0.0, 0.7, 0.7 + step]))
    later = (path[2] * path[1].inv()).as_rotvec() / step
    before, after = first.inv().apply(spin), path[1].inv().apply(later)
    assert before @ (inertia * before) == pytest.approx(after @ (inertia * after), rel=2e-3)
    assert path[1].apply(inertia * after) == pytest.approx(first.apply(inertia * before), rel=5e-3, abs=2e-5)


def test_a_free_rotation_is_found_from_orientations() -> None:
    inertia = unit_inertia("box", HALF[None], np.zeros(1))[0]
    spin = np.array([2.0, -4.0, 3.0])
    path = free_rotation(inertia, Rotation.from_rotvec([0.1, 0.4, 0.0]), spin, TIMES)
    first, found = free_rotation_through("box", HALF, path.as_matrix(), TIMES)
    assert found == pytest.approx(spin, abs=0.02)
    assert (first.inv() * path[0]).magnitude() < 0.01


def test_a_box_that_tumbles_through_the_air() -> None:
    plane = Plane(480, 320, px_per_m=200.0)
    turn = Rotation.from_rotvec([0.4, 0.3, -0.2]).as_quat(scalar_first=True)
    box = SceneObject(
        "box",
        (0.14, 0.26, 0.4),
        1.0,
        position=(-0.7, 0, -0.2),
        velocity=(1.4, 0, 3.0),
        angular_velocity=(1.0, 3.0, -1.5),
        orientation=tuple(turn),
    )
    scene = Scene((box,), plane.camera(), ground=None)
    shown = replay_poses(scene, SCHEDULE)
    answer = find_planar_scene(measure_motion(shown.masks, shown.pictures("raycast"), TIMES))
    assert answer.scene.composition == "box"
    assert overlap(masks_at(answer.scene, TIMES, 480, 320), shown.masks, 1, 1).sequence > 0.85
