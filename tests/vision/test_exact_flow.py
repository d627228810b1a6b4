import numpy as np
import pytest
from random_scene import HEIGHT, WIDTH, View, pixel_rays, random_view, unit

from pipeline.scene.rotation import integrate, matrix_from_quaternion, rotate
from pipeline.scene.scene import Camera, SceneObject
from pipeline.vision.rendering.camera import focal_px, pinhole, project
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import rasterise

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
LEVEL = pinhole(Camera((0, -2, 0.5), 45, pitch=0))


def moved(view: View, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions (2, N, 3) and quaternions (2, N, 4): the view's, and after a small random motion."""
    count = len(view.objects)
    position = view.position + 0.05 * rng.normal(size=(count, 3))
    quaternion = integrate(view.quaternion, rng.normal(size=(count, 3)), 0.2)
    return np.stack([view.position, position]), np.stack([view.quaternion, quaternion])


@pytest.mark.parametrize("near", [False, True])
def test_flow_is_where_the_surface_point_goes_when_its_body_moves(rng: np.random.Generator, near: bool) -> None:
    for _ in range(10):
        view = random_view(rng, near=near)
        positions, quaternions = moved(view, rng)
        seen = rasterise(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, view.ground)
        flow = exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, view.ground)[0]
        rows, cols = np.nonzero(seen.mask[0])
        body = seen.mask[0][rows, cols].astype(int) - 1
        depth = seen.depth[0][rows, cols].astype(np.float64)
        world = view.camera.position_world + depth[:, None] * pixel_rays(view.camera)[rows, cols]
        own = np.einsum("nji,nj->ni", matrix_from_quaternion(quaternions[0, body]), world - positions[0, body])
        uv, ahead = project(rotate(quaternions[1, body], own) + positions[1, body], view.camera, WIDTH, HEIGHT)
        expected = uv - np.stack([cols + 0.5, rows + 0.5], axis=1)
        front = ahead > 0.01
        np.testing.assert_allclose(flow[rows, cols][front], expected[front], rtol=1e-4, atol=1e-3)
        assert not flow[rows, cols][ahead <= 0].any()
        assert not flow[seen.mask[0] == 0].any()


def test_a_box_that_slides_along_the_image_plane_has_one_flow() -> None:
    box = (SceneObject("box", (0.5, 0.5, 0.5), 1.0),)
    positions = np.array([[[0.0, 1.25, 0.5]], [[0.03, 1.25, 0.48]]])
    found = exact_flow(box, positions, np.tile(UPRIGHT, (2, 1, 1)), LEVEL, 120, 80, None)
    inside = rasterise(box, positions, np.tile(UPRIGHT, (2, 1, 1)), LEVEL, 120, 80, None).mask[0] > 0
    scale = focal_px(45, 80) / 3.0  # its face is 3 m away
    np.testing.assert_allclose(found[0][inside] - scale * np.array([0.03, 0.02]), 0, atol=1e-4)


def test_a_body_that_comes_nearer_flows_away_from_the_middle() -> None:
    box = (SceneObject("box", (0.5, 0.5, 0.5), 1.0),)
    positions = np.array([[[0.0, 1.25, 0.5]], [[0.0, 0.95, 0.5]]])
    flow = exact_flow(box, positions, np.tile(UPRIGHT, (2, 1, 1)), LEVEL, 120, 80, None)[0]
    rows, cols = np.nonzero(np.any(flow, axis=2))
    expected = np.stack([cols + 0.5 - 60, rows + 0.5 - 40], axis=1) * (3.0 / 2.7 - 1)
    np.testing.assert_allclose(flow[rows, cols], expected, atol=1e-4)


def test_flow_is_the_finite_difference_of_the_motion(rng: np.random.Generator) -> None:
    view = random_view(rng, "sphere")
    velocity, omega = rng.normal(size=view.position.shape), rng.normal(size=view.position.shape)

    def flow(h: float) -> np.ndarray:
        positions = np.stack([view.position, view.position + h * velocity])
        quaternions = np.stack([view.quaternion, integrate(view.quaternion, omega, h)])
        return exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, None)[0] / h

    small, half = flow(1e-3), flow(5e-4)
    assert np.abs(small - half).max() < 0.02 * max(np.abs(small).max(), 1.0)


def test_a_body_at_rest_has_no_flow(rng: np.random.Generator) -> None:
    view = random_view(rng)
    still = (np.stack([view.position] * 2), np.stack([view.quaternion] * 2))
    found = exact_flow(view.objects, *still, view.camera, WIDTH, HEIGHT, view.ground)
    np.testing.assert_allclose(found, 0, atol=1e-4)


def test_one_frame_has_no_flow() -> None:
    ball = (SceneObject("sphere", (0.3,), 1.0),)
    assert exact_flow(ball, np.zeros((1, 1, 3)), UPRIGHT[None, None], LEVEL, 12, 8).shape == (0, 8, 12, 2)


def test_turning_quaternions_sign_changes_no_flow(rng: np.random.Generator) -> None:
    view = random_view(rng)
    positions, quaternions = moved(view, rng)
    one = exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT)
    quaternions[1] *= -1
    two = exact_flow(view.objects, positions, unit(quaternions), view.camera, WIDTH, HEIGHT)
    np.testing.assert_allclose(one, two, atol=1e-3)
