import numpy as np
import pytest

from pipeline.scene.mjcf import camera_quaternion
from pipeline.scene.scene import Camera
from pipeline.vision.rendering.camera import focal_px, pinhole, project


def test_a_pitched_camera_is_the_one_with_the_same_orientation(rng: np.random.Generator) -> None:
    pitched = Camera((0.1, -2, 0.8), 42, pitch=float(rng.uniform(-90, 90)))
    turned = Camera((0.1, -2, 0.8), 42, orientation=tuple(camera_quaternion(pitched)))
    np.testing.assert_allclose(pinhole(pitched).rotation_world, pinhole(turned).rotation_world, atol=1e-5)


def test_the_point_ahead_is_in_the_middle_and_up_is_up() -> None:
    camera = pinhole(Camera((0, -2, 0.8), 42, pitch=-22))
    ahead = camera.position_world - 3 * camera.rotation_world[:, 2]
    uv, depth = project(ahead + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]]), camera, 120, 80)
    np.testing.assert_allclose(uv[0], [60, 40], atol=1e-9)
    assert depth[0] == pytest.approx(3)
    assert uv[1, 0] > 60
    assert uv[2, 1] < 40


def test_the_field_of_view_spans_the_images_height() -> None:
    camera = pinhole(Camera((0, 0, 0), 50, pitch=0))
    edge = np.tan(np.radians(25))
    uv, _ = project(np.array([[0, 1, edge], [0, 1, -edge], [edge, 1, 0]]), camera, 300, 200)
    np.testing.assert_allclose(uv, [[150, 0], [150, 200], [250, 100]], atol=1e-9)
    assert focal_px(50, 200) == pytest.approx(100 / edge)
