from dataclasses import replace

import numpy as np
import pytest
from random_scene import random_view, unit

from pipeline.scene.rotation import integrate, quaternion_multiply, rotate
from pipeline.scene.scene import Camera, SceneObject
from pipeline.vision.rendering.appearance import (
    Appearance,
    Backdrop,
    Light,
    Material,
    plain_appearance,
    sample_appearance,
)
from pipeline.vision.rendering.camera import Pinhole, pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.shade import shade

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
DOWN = pinhole(Camera((0, 0, 4), 40, pitch=-90))
CAMERA = pinhole(Camera((0, -2, 0.8), 42, pitch=-18))
SIZE = (96, 64)


def overhead(**light: float) -> Appearance:
    lamp = Light((0.6, 0.6, 0.6), towards=(0.0, 0.0, 1.0), **light)
    white = Material((0.8, 0.8, 0.8), specular=0.0)
    return Appearance((white,), white, Backdrop(), (lamp,), ambient=0.3, haze=1e15)


def test_the_same_arguments_give_the_same_bytes(rng: np.random.Generator) -> None:
    view = random_view(rng)
    look = sample_appearance(rng, len(view.objects))
    poses = (view.position[None], view.quaternion[None])
    one, two = (shade(view.objects, *poses, view.camera, look, *SIZE) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_a_ball_casts_a_shadow_of_its_own_size_under_a_light_overhead() -> None:
    ball = (SceneObject("sphere", (0.2,), 1.0),)
    # From the side and above, so that the ball does not hide its shadow: straight under it, at the origin.
    camera = pinhole(Camera((0, -3, 3), 40, pitch=-45))
    poses = (np.array([[[0.0, 0.0, 1.5]]]), UPRIGHT[None, None])
    lit = shade(ball, *poses, camera, overhead(), 200, 200, shadows=False)[0].astype(int)
    dark = shade(ball, *poses, camera, overhead(), 200, 200, shadows=True)[0].astype(int)
    floor = rasterise(ball, *poses, camera, 200, 200).mask[0] == 0
    shadow = floor & (lit[..., 0] - dark[..., 0] > 60)
    rows, cols = np.nonzero(shadow)
    focal = 100 / np.tan(np.radians(20))
    assert cols.max() - cols.min() + 1 == pytest.approx(0.4 * focal / np.hypot(3, 3), rel=0.1)
    assert abs(rows.mean() - 100) < 2
    assert abs(cols.mean() + 0.5 - 100) < 1


def test_a_wide_light_softens_the_shadows_edge() -> None:
    ball = (SceneObject("sphere", (0.2,), 1.0),)
    camera = pinhole(Camera((0, -3, 3), 40, pitch=-45))
    poses = (np.array([[[0.0, 0.0, 1.5]]]), UPRIGHT[None, None])
    hard, soft = (shade(ball, *poses, camera, overhead(radius=r), 200, 200)[0] for r in (0.0, 0.1))
    floor = rasterise(ball, *poses, camera, 200, 200).mask[0] == 0
    levels = [len(np.unique(picture[floor][:, 0])) for picture in (hard, soft)]
    assert levels[1] > levels[0]


def test_lambert_a_plain_floor_has_ambient_and_diffuse_light() -> None:
    floor = shade((), np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), DOWN, replace(overhead(), materials=()), *SIZE)
    np.testing.assert_allclose(floor, round(255 * 0.8 * (0.3 + 0.6)), atol=1)


def test_a_textured_ball_shows_its_spin_and_a_plain_one_does_not() -> None:
    ball = (SceneObject("sphere", (0.4,), 1.0),)
    positions = np.tile([0.0, 0.0, 0.4], (2, 1, 1))
    quaternions = np.stack([UPRIGHT, integrate(UPRIGHT, np.array([0.0, 1.0, 0.5]), 0.5)])[:, None]
    for texture, turns in (("plain", False), ("stripes", True), ("checker", True), ("noise", True), ("spots", True)):
        look = plain_appearance(1)
        look = replace(look, materials=(replace(look.materials[0], texture=texture),))
        one, two = shade(ball, positions, quaternions, CAMERA, look, *SIZE).astype(int)
        assert (np.abs(one - two).max() > 30) == turns


def test_turning_the_world_about_the_vertical_turns_the_picture_with_it(rng: np.random.Generator) -> None:
    view = random_view(rng)
    look = sample_appearance(rng, len(view.objects), floor_textures={"plain": 1.0}, backdrops={"gradient": 1.0})
    turn = np.array([np.cos(0.4), 0, 0, np.sin(0.4)])

    def turned(light: Light) -> Light:
        place = tuple(rotate(turn, np.array(light.towards or light.position)))
        return replace(light, towards=place) if light.towards else replace(light, position=place)

    look = replace(look, lights=tuple(replace(x, radius=0.0) for x in look.lights))
    other = replace(look, lights=tuple(turned(x) for x in look.lights))
    one = shade(view.objects, view.position[None], view.quaternion[None], CAMERA, look, *SIZE)
    camera = Pinhole(rotate(turn, CAMERA.position_world), rotate(turn, CAMERA.rotation_world.T).T, CAMERA.fov_y_deg)
    poses = (rotate(turn, view.position)[None], quaternion_multiply(turn, view.quaternion)[None])
    two = shade(view.objects, *poses, camera, other, *SIZE)
    assert (np.abs(one.astype(int) - two).max(axis=3) > 3).mean() < 0.01


def test_every_shape_and_texture_is_drawn_where_its_mask_is(rng: np.random.Generator) -> None:
    view = random_view(rng)
    red = Material((1.0, 0.0, 0.0), specular=0.0)
    blue = Material((0.0, 0.0, 1.0), specular=0.0)
    look = Appearance((red,) * len(view.objects), blue, Backdrop((0, 1, 0), (0, 1, 0)), (), ambient=1.0, haze=1e15)
    poses = (view.position[None], view.quaternion[None])
    picture = shade(view.objects, *poses, view.camera, look, *SIZE, view.ground, shadows=False, antialias=False)
    seen = rasterise(view.objects, *poses, view.camera, *SIZE, view.ground)
    np.testing.assert_array_equal(picture[..., 0] > 0, seen.mask > 0)
    np.testing.assert_array_equal(picture[..., 2] > 0, (seen.mask == 0) & np.isfinite(seen.depth))
    np.testing.assert_array_equal(picture[..., 1] > 0, np.isinf(seen.depth))


def test_antialiasing_changes_only_what_lies_on_an_edge() -> None:
    ball = (SceneObject("sphere", (0.4,), 1.0),)
    poses = (np.array([[[0.0, 0.0, 0.6]]]), UPRIGHT[None, None])
    look = replace(overhead(), floor=Material((0.2, 0.2, 0.2), specular=0.0))
    draft, smooth = (shade(ball, *poses, DOWN, look, *SIZE, shadows=False, antialias=a)[0] for a in (False, True))
    mask = rasterise(ball, *poses, DOWN, *SIZE).mask[0]
    edge = np.zeros_like(mask, dtype=bool)
    edge[:, 1:] |= mask[:, 1:] != mask[:, :-1]
    edge[1:] |= mask[1:] != mask[:-1]
    near = edge.copy()
    near[:, :-1] |= edge[:, 1:]
    near[:-1] |= edge[1:]
    assert (draft != smooth).any()
    assert not (draft != smooth).any(axis=2)[~near & (mask == 0)].any()


def test_quaternions_need_not_be_of_unit_length(rng: np.random.Generator) -> None:
    view = random_view(rng)
    look = sample_appearance(rng, len(view.objects))
    one, two = (
        shade(view.objects, view.position[None], (s * unit(view.quaternion))[None], CAMERA, look, *SIZE) for s in (1, 2)
    )
    assert (np.abs(one.astype(int) - two).max(axis=3) > 3).mean() < 1e-3
