"""How round bodies turn, from their texture."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.outlines.spin import about
from pipeline.vision.rendering.camera import pinhole

SCHEDULE = Schedule()
CAMERA = Camera(position=(0.0, -2.0, 0.8), pitch=-16.0, fov=45.0)


def test_rotations_about_vectors_are_those_of_rodrigues() -> None:
    vectors = np.random.default_rng(0).normal(size=(40, 3))
    vectors[0] = 0
    np.testing.assert_allclose(about(vectors, 0.7), Rotation.from_rotvec(0.7 * vectors).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("spin", [(0.0, 4.0, 0.0), (0.0, 4.0, 4.0), (2.0, 0.0, -4.0)])
def test_a_ball_is_said_to_roll_only_where_its_texture_does(spin: tuple[float, float, float]) -> None:
    ball = SceneObject(
        "sphere",
        (0.25,),
        1.0,
        sliding_friction=0.0,
        position=(-0.5, 0.2, 0.25),
        velocity=(1.0, 0, 0),
        angular_velocity=spin,
    )
    scene = Scene((ball,), CAMERA)
    run = replay_poses(scene, SCHEDULE)
    pictures, times = run.pictures("raycast"), np.arange(SCHEDULE.frames) / SCHEDULE.fps
    (evidence,) = ClipOutlines(run.masks, times, 1, pictures).evidence
    found = evidence.registrations["sphere"]
    assert found.turns_seen.all()
    camera = pinhole(CAMERA).rotation_world.T
    rotations = Rotation.from_quat(run.quaternion[found.frames, 0], scalar_first=True)
    true = Rotation.from_matrix(camera @ (rotations[1:] * rotations[:-1].inv()).as_matrix() @ camera.T)
    errors = (Rotation.from_matrix(found.turns) * true.inv()).magnitude()
    assert np.median(errors) < 0.03  # rad, of turns by 0.13 to 0.19
