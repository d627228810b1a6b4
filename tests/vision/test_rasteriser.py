import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from random_scene import HEIGHT, WIDTH, View, mujoco_sees, pixel_rays, random_camera, random_fixed, random_view, unit

from pipeline.errors import SceneError
from pipeline.scene.mjcf import camera_quaternion
from pipeline.scene.rotation import quaternion_multiply, rotate
from pipeline.scene.scene import FIXED_SIZE_KEYS, Camera, SceneObject
from pipeline.vision.rendering.camera import Pinhole, pinhole, project
from pipeline.vision.rendering.rasteriser import Rendering, background_depth, rasterise, rasterise_frames
from pipeline.vision.rendering.surface import KINDS, shape_arrays

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
LEVEL = Pinhole(np.array([0.0, -2.0, 0.5]), pinhole(Camera((0, -2, 0.5), 45, pitch=0)).rotation_world, 45.0)


def see(view: View) -> Rendering:
    poses = (view.position[None], view.quaternion[None])
    return rasterise(view.objects, *poses, view.camera, WIDTH, HEIGHT, view.ground, view.fixed)


def assert_agrees_with_mujoco(draw: Callable[[], View], scenes: int) -> None:
    """Compare until `scenes` of the views drawn show something; those that show nothing are compared too."""
    different, drawn, shown = 0, 0, 0
    while shown < scenes:
        view = draw()
        ours = see(view)
        mask, depth = mujoco_sees(view)
        same = ours.mask[0] == mask
        different += int((~same).sum())
        drawn += 1
        shown += int((mask > 0).mean() > 0.01)
        hit = same & np.isfinite(depth) & (depth < 1e6)
        np.testing.assert_allclose(ours.depth[0][hit], depth[hit], rtol=1e-5)
        assert np.mean(np.isfinite(ours.depth[0]) != np.isfinite(depth)) < 1e-3
    assert different <= 1e-3 * drawn * WIDTH * HEIGHT


@pytest.mark.parametrize("shape", list(KINDS))
def test_masks_and_depths_of_each_shape_are_those_of_mujocos_rays(rng: np.random.Generator, shape: str) -> None:
    assert_agrees_with_mujoco(lambda: random_view(rng, shape), scenes=4)


def test_masks_among_the_objects_are_those_of_mujocos_rays(rng: np.random.Generator) -> None:
    assert_agrees_with_mujoco(lambda: random_view(rng, near=True), scenes=8)


@pytest.mark.parametrize("shape", [s for s in FIXED_SIZE_KEYS if s != "mesh"])
def test_fixed_bodies_hide_what_is_behind_them_as_mujocos_rays_say(rng: np.random.Generator, shape: str) -> None:
    def draw() -> View:
        fixed = (random_fixed(rng, shape), random_fixed(rng))
        return replace(random_view(rng, near=rng.random() < 0.25), fixed=fixed)

    assert_agrees_with_mujoco(draw, scenes=4)


def far_view(rng: np.random.Generator) -> View:
    """A camera 20 to 60 m away with a small field of view."""
    view = random_view(rng)
    distance = rng.uniform(20, 60)
    camera = replace(random_camera(rng, view.position[0], distance), fov_y_deg=float(rng.uniform(2, 5)))
    back = unit(camera.position_world - view.position[0])
    right = unit(np.cross(rng.normal(size=3), back))
    aimed = replace(camera, rotation_world=np.stack([right, np.cross(back, right), back], axis=1))
    return replace(view, camera=aimed, fixed=(random_fixed(rng),))


def low_view(rng: np.random.Generator) -> View:
    """A camera that rolls, near the ground or below it, and looks almost along it."""
    view = random_view(rng)
    heading, height = rng.uniform(-np.pi, np.pi), rng.uniform(-0.3, 0.1)
    eye = np.array([2 * np.cos(heading), 2 * np.sin(heading), height])
    back, roll = unit(eye + np.array([0, 0, rng.uniform(-0.3, 0.3)])), rng.normal(size=3)
    right = unit(np.cross(roll, back))
    camera = Pinhole(eye, np.stack([right, np.cross(back, right), back], axis=1), float(rng.uniform(30, 80)))
    return replace(view, camera=camera, fixed=(random_fixed(rng),))


def top_view(rng: np.random.Generator) -> View:
    """A camera that looks straight down, with any roll."""
    view = random_view(rng)
    roll = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    camera = Pinhole(np.array([*view.position[0, :2], rng.uniform(2, 4)]), turn, float(rng.uniform(30, 70)))
    return replace(view, camera=camera, fixed=(random_fixed(rng),))


@pytest.mark.parametrize("pose", [far_view, low_view, top_view])
def test_masks_of_unusual_cameras_are_those_of_mujocos_rays(
    rng: np.random.Generator, pose: Callable[[np.random.Generator], View]
) -> None:
    assert_agrees_with_mujoco(lambda: pose(rng), scenes=6)


def test_the_two_descriptions_of_a_camera_that_looks_down_agree() -> None:
    down, turned = Camera((0, 0, 2), 40, pitch=-90), Camera((0, 0, 2), 40, orientation=(1, 0, 0, 0))
    np.testing.assert_allclose(pinhole(down).rotation_world, pinhole(turned).rotation_world, atol=1e-12)
    np.testing.assert_allclose(camera_quaternion(down), camera_quaternion(turned), atol=1e-12)


@pytest.mark.slow
def test_masks_of_200_scenes_are_those_of_mujocos_rays(rng: np.random.Generator) -> None:
    assert_agrees_with_mujoco(lambda: random_view(rng, near=rng.random() < 0.25), scenes=200)


def test_depth_of_a_sphere_ahead_is_the_distance_to_its_front() -> None:
    ball = (SceneObject("sphere", (0.3,), 1.0),)
    seen = rasterise(ball, np.array([[[0.0, 1.0, 0.5]]]), UPRIGHT[None, None], LEVEL, 101, 101, None)
    assert seen.depth[0, 50, 50] == pytest.approx(3.0 - 0.3, rel=1e-6)


def test_a_sphere_covers_the_disc_of_its_tangent_cone() -> None:
    ball = (SceneObject("sphere", (0.4,), 1.0),)
    seen = rasterise(ball, np.array([[[0.0, 1.0, 0.5]]]), UPRIGHT[None, None], LEVEL, 400, 400, None)
    focal = 200 / math.tan(math.radians(22.5))
    radius = focal * math.tan(math.asin(0.4 / 3.0))
    assert (seen.mask > 0).sum() == pytest.approx(math.pi * radius**2, rel=0.01)


def test_a_box_face_seen_straight_has_one_depth_and_the_right_width() -> None:
    box = (SceneObject("box", (0.5, 1.0, 0.5), 1.0),)
    seen = rasterise(box, np.array([[[0.0, 1.5, 0.5]]]), UPRIGHT[None, None], LEVEL, 240, 160, None)
    inside = seen.mask[0] > 0
    np.testing.assert_allclose(seen.depth[0][inside], 3.0, rtol=1e-6)
    focal = 80 / math.tan(math.radians(22.5))
    assert inside.any(0).sum() == pytest.approx(0.5 * focal / 3.0, abs=1)


def test_ground_depth_follows_from_the_cameras_height() -> None:
    camera = pinhole(Camera((0, 0, 1.5), 60, pitch=-90))
    seen = rasterise((), np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), camera, 60, 40, 0.25)
    np.testing.assert_allclose(seen.depth, 1.25, rtol=1e-6)
    assert not seen.mask.any()


def test_the_ground_is_not_seen_from_below() -> None:
    camera = pinhole(Camera((0, 0, -1), 60, pitch=90))
    ball = (SceneObject("sphere", (0.2,), 1.0),)
    seen = rasterise(ball, np.array([[[0.0, 0.0, 0.5]]]), UPRIGHT[None, None], camera, 60, 40, 0.0)
    assert seen.mask.any()
    assert np.isinf(seen.depth[seen.mask == 0]).all()


def test_the_ground_hides_what_lies_below_it() -> None:
    ball = (SceneObject("sphere", (0.2,), 1.0),)
    poses = (np.array([[[0.0, 0.0, -0.3]]]), UPRIGHT[None, None])
    camera = pinhole(Camera((0, -2, 0.8), 42, pitch=-22))
    assert not rasterise(ball, *poses, camera, 120, 80, 0.0).mask.any()
    assert rasterise(ball, *poses, camera, 120, 80, None).mask.any()


def test_from_inside_a_shape_its_far_wall_is_seen() -> None:
    ball = (SceneObject("sphere", (0.5,), 1.0),)
    seen = rasterise(ball, LEVEL.position_world[None, None], UPRIGHT[None, None], LEVEL, 61, 61, None)
    assert (seen.mask == 1).all()
    assert seen.depth[0, 30, 30] == pytest.approx(0.5, rel=1e-6)


def test_what_is_behind_the_camera_is_not_seen() -> None:
    box = (SceneObject("box", (0.5, 0.5, 0.5), 1.0),)
    assert not rasterise(box, np.array([[[0.0, -3.0, 0.5]]]), UPRIGHT[None, None], LEVEL, 60, 40, None).mask.any()


def test_a_mirrored_scene_gives_the_mirrored_mask(rng: np.random.Generator) -> None:
    view = random_view(rng)
    camera = pinhole(Camera((0, -2.5, 0.9), 50, pitch=-15))
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = np.array([1.0, 1.0, -1.0, -1.0])  # a turn about (x, y, z) becomes one about (x, -y, -z)
    one = rasterise(view.objects, view.position[None], view.quaternion[None], camera, WIDTH, HEIGHT)
    two = rasterise(
        view.objects, (flip * view.position)[None], (mirrored * view.quaternion)[None], camera, WIDTH, HEIGHT
    )
    assert (one.mask[:, :, ::-1] != two.mask).mean() < 1e-3


def test_turning_the_whole_world_changes_nothing(rng: np.random.Generator) -> None:
    view = random_view(rng)
    turn, shift = unit(rng.normal(size=4)), rng.normal(size=3)
    camera = view.camera
    turned = Pinhole(
        rotate(turn, camera.position_world) + shift, rotate(turn, camera.rotation_world.T).T, camera.fov_y_deg
    )
    positions = rotate(turn, view.position) + shift
    quaternions = quaternion_multiply(turn, view.quaternion)
    one = rasterise(view.objects, view.position[None], view.quaternion[None], camera, WIDTH, HEIGHT, None)
    two = rasterise(view.objects, positions[None], quaternions[None], turned, WIDTH, HEIGHT, None)
    assert (one.mask != two.mask).mean() < 1e-3


def test_each_frame_is_what_it_is_alone_whatever_was_in_the_buffers(rng: np.random.Generator) -> None:
    views = [random_view(rng, shape) for shape in KINDS]
    first = views[0]
    count = len(first.objects)
    positions = rng.uniform(-0.5, 0.8, (4, count, 3))
    quaternions = unit(rng.normal(size=(4, count, 4)))
    together = rasterise(first.objects, positions, quaternions, first.camera, WIDTH, HEIGHT)
    mask = np.full((1, HEIGHT, WIDTH), 77, dtype=np.uint8)
    depth = np.full((1, HEIGHT, WIDTH), 0.01, dtype=np.float32)
    camera = first.camera
    eye, rotation = camera.position_world, np.ascontiguousarray(camera.rotation_world)
    behind = background_depth(camera, WIDTH, HEIGHT, 0.0, ())
    for k in range(4):
        poses = (positions[k : k + 1], quaternions[k : k + 1])
        rasterise_frames(*shape_arrays(first.objects), *poses, eye, rotation, camera.fov_y_deg, behind, mask, depth)
        np.testing.assert_array_equal(mask[0], together.mask[k])
        np.testing.assert_array_equal(depth[0], together.depth[k])


def test_poses_that_are_not_numbers_show_nothing() -> None:
    objects = (SceneObject("sphere", (0.2,), 1.0), SceneObject("box", (0.2, 0.5, 0.3), 1.0))
    positions = np.full((1, 2, 3), np.nan)
    positions[0, 1] = np.inf
    assert not rasterise(objects, positions, np.tile(UPRIGHT, (1, 2, 1)), LEVEL, 60, 40).mask.any()


def test_a_mesh_is_refused_by_name() -> None:
    mesh = (SceneObject("sphere", (0.1,), 1.0), SceneObject("mesh", (1.0,), 1.0, file="bunny.obj"))
    with pytest.raises(SceneError, match=r"objects\[1\].shape: mesh .* sphere, cylinder, box"):
        rasterise(mesh, np.zeros((1, 2, 3)), np.tile(UPRIGHT, (1, 2, 1)), LEVEL, 60, 40)


def test_a_pixels_depth_projects_back_into_its_centre(rng: np.random.Generator) -> None:
    camera = random_camera(rng, np.zeros(3), 2.0)
    depth = rng.uniform(0.1, 5.0, (HEIGHT, WIDTH))
    uv, planar = project(camera.position_world + depth[..., None] * pixel_rays(camera), camera, WIDTH, HEIGHT)
    rows, cols = np.mgrid[:HEIGHT, :WIDTH]
    np.testing.assert_allclose(uv, np.stack([cols + 0.5, rows + 0.5], axis=-1), atol=1e-8)
    np.testing.assert_allclose(planar, depth, rtol=1e-10)
