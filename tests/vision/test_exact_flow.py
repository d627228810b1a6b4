import numpy as np
import pytest
from random_scene import HEIGHT, WIDTH, View, pixel_rays, random_view, unit

from pipeline.scene.rotation import integrate, matrix_from_quaternion, rotate
from pipeline.scene.scene import Camera, SceneObject
from pipeline.vision.camera import focal_px, pinhole, project
from pipeline.vision.exact_flow import exact_flow
from pipeline.vision.rasteriser import rasterise

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
        flow = exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, view.ground).flow_px[0]
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
    np.testing.assert_allclose(found.flow_px[0][inside] - scale * np.array([0.03, 0.02]), 0, atol=1e-4)


def test_a_body_that_comes_nearer_flows_away_from_the_middle() -> None:
    box = (SceneObject("box", (0.5, 0.5, 0.5), 1.0),)
    positions = np.array([[[0.0, 1.25, 0.5]], [[0.0, 0.95, 0.5]]])
    flow = exact_flow(box, positions, np.tile(UPRIGHT, (2, 1, 1)), LEVEL, 120, 80, None).flow_px[0]
    rows, cols = np.nonzero(np.any(flow, axis=2))
    expected = np.stack([cols + 0.5 - 60, rows + 0.5 - 40], axis=1) * (3.0 / 2.7 - 1)
    np.testing.assert_allclose(flow[rows, cols], expected, atol=1e-4)


def test_flow_is_the_finite_difference_of_the_motion(rng: np.random.Generator) -> None:
    view = random_view(rng, "sphere")
    velocity, omega = rng.normal(size=view.position.shape), rng.normal(size=view.position.shape)

    def flow(h: float) -> np.ndarray:
        positions = np.stack([view.position, view.position + h * velocity])
        quaternions = np.stack([view.quaternion, integrate(view.quaternion, omega, h)])
        return exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, None).flow_px[0] / h

    small, half = flow(1e-3), flow(5e-4)
    assert np.abs(small - half).max() < 0.02 * max(np.abs(small).max(), 1.0)


def test_a_body_at_rest_has_no_flow_and_nothing_hidden(rng: np.random.Generator) -> None:
    view = random_view(rng)
    still = (np.stack([view.position] * 2), np.stack([view.quaternion] * 2))
    found = exact_flow(view.objects, *still, view.camera, WIDTH, HEIGHT, view.ground)
    np.testing.assert_allclose(found.flow_px, 0, atol=1e-4)
    assert not found.hidden.any()


def test_points_are_hidden_behind_what_moves_before_them() -> None:
    boxes = (SceneObject("box", (0.4, 0.4, 0.4), 1.0), SceneObject("box", (0.8, 0.1, 0.8), 1.0))
    positions = np.array([[[0.0, 1.0, 0.5], [1.5, 0.0, 0.5]], [[0.0, 1.0, 0.5], [0.0, 0.0, 0.5]]])
    poses = (positions, np.tile(UPRIGHT, (2, 2, 1)))
    mask = rasterise(boxes, *poses, LEVEL, 120, 80, None).mask
    hidden = exact_flow(boxes, *poses, LEVEL, 120, 80, None).hidden[0]
    assert (mask[0] == 1).any()
    assert hidden[mask[0] == 1].all()
    assert not hidden[mask[0] == 0].any()


def test_points_are_hidden_that_turn_away_sink_or_leave_the_view() -> None:
    box = (SceneObject("box", (0.4, 0.4, 0.4), 1.0),)
    here, half_turn = np.array([0.0, 1.0, 0.5]), np.array([0.0, 0.0, 0.0, 1.0])
    for there, turn in ((here, half_turn), (here - [0, 0, 1.0], UPRIGHT), (here - [3.0, 0, 0], UPRIGHT)):
        poses = (np.stack([here, there])[:, None], np.stack([UPRIGHT, turn])[:, None])
        mask = rasterise(box, *poses, LEVEL, 120, 80, 0.0).mask[0] > 0
        hidden = exact_flow(box, *poses, LEVEL, 120, 80, 0.0).hidden[0]
        assert (hidden == mask).all()


def test_what_is_not_hidden_is_seen_where_the_flow_leads(rng: np.random.Generator) -> None:
    agree, total = 0, 0
    for _ in range(10):
        view = random_view(rng)
        positions, quaternions = moved(view, rng)
        seen = rasterise(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, view.ground)
        found = exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT, view.ground)
        rows, cols = np.nonzero((seen.mask[0] > 0) & ~found.hidden[0])
        target = np.stack([cols, rows], axis=1) + 0.5 + found.flow_px[0][rows, cols]
        x, y = np.clip(target[:, 0].astype(int), 0, WIDTH - 1), np.clip(target[:, 1].astype(int), 0, HEIGHT - 1)
        agree += int((seen.mask[1][y, x] == seen.mask[0][rows, cols]).sum())
        total += len(rows)
    assert agree >= 0.9 * total  # the rest lies in pixels on an edge


def test_one_frame_has_no_flow() -> None:
    ball = (SceneObject("sphere", (0.3,), 1.0),)
    assert exact_flow(ball, np.zeros((1, 1, 3)), UPRIGHT[None, None], LEVEL, 12, 8).flow_px.shape == (0, 8, 12, 2)


def test_turning_quaternions_sign_changes_no_flow(rng: np.random.Generator) -> None:
    view = random_view(rng)
    positions, quaternions = moved(view, rng)
    one = exact_flow(view.objects, positions, quaternions, view.camera, WIDTH, HEIGHT).flow_px
    quaternions[1] *= -1
    two = exact_flow(view.objects, positions, unit(quaternions), view.camera, WIDTH, HEIGHT).flow_px
    np.testing.assert_allclose(one, two, atol=1e-3)
