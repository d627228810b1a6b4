from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pipeline.physics.simulate import compile_xml
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.rotation import matrix_from_quaternion, rotate
from pipeline.scene.scene import SIZE_KEYS, Scene, SceneObject, half_extents
from pipeline.scene.solid import bounding_radii, geom_sizes, principal_moments, reach_below, unit_inertia

SHAPES = [s for s in SIZE_KEYS if s != "mesh"]


def random_object(rng: np.random.Generator, shape: str) -> SceneObject:
    size = rng.uniform(0.05, 0.5, len(SIZE_KEYS[shape]))
    if shape == "capsule":
        size[1] += 2 * size[0]
    return SceneObject(shape, tuple(size), mass=rng.uniform(0.1, 5), orientation=tuple(rng.normal(size=4)))


def surface_points(rng: np.random.Generator, obj: SceneObject, count: int) -> np.ndarray:
    """Points of the body's surface or inside, with its corners and edges well covered, in its own frame."""
    half = half_extents(obj)
    around = rng.uniform(0, 2 * np.pi, count)
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    if obj.shape in ("sphere", "ellipsoid"):
        return unit * half
    if obj.shape == "box":
        return rng.choice([-1.0, 1.0], (count, 3)) * half
    if obj.shape == "cylinder":
        return np.stack(
            [half[0] * np.cos(around), half[0] * np.sin(around), half[2] * rng.choice([-1.0, 1.0], count)], 1
        )
    caps = np.array([0, 0, half[2] - half[0]]) * rng.choice([-1.0, 1.0], (count, 1))
    return unit * half[0] + caps


@pytest.mark.parametrize("shape", SHAPES)
def test_inertia_and_sizes_are_those_of_mujocos_compiler(rng: np.random.Generator, shape: str) -> None:
    obj = random_object(rng, shape)
    model = compile_xml(scene_xml(Scene((obj,), ground=None)))
    half = half_extents(obj)[None]
    principal = matrix_from_quaternion(model.body_iquat[1])
    inertia = principal @ np.diag(model.body_inertia[1]) @ principal.T
    np.testing.assert_allclose(np.diag(obj.mass * unit_inertia(shape, half, np.zeros(1))[0]), inertia, atol=1e-12)
    np.testing.assert_allclose(geom_sizes(shape, half)[0], model.geom_size[0], rtol=1e-12)
    np.testing.assert_allclose(bounding_radii(shape, half)[0], model.geom_rbound[0], rtol=1e-9)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_a_hollow_body_has_the_inertia_of_the_whole_less_its_hole(rng: np.random.Generator, shape: str) -> None:
    hollow = rng.uniform(0.1, 0.99)
    half = rng.uniform(0.1, 0.5, (1, 3))
    half[:, 1] = half[:, 0]
    if shape == "sphere":
        half[:, 2] = half[:, 0]
    hole = half * [hollow, hollow, hollow if shape == "sphere" else 1.0]
    share = hollow**3 if shape == "sphere" else hollow**2  # of the volume
    solid = np.zeros(1)
    difference = unit_inertia(shape, half, solid) - share * unit_inertia(shape, hole, solid)
    found = unit_inertia(shape, half, np.array([hollow]))
    np.testing.assert_allclose(found, difference / (1 - share), rtol=1e-9)


def test_thin_shells_have_the_inertia_of_the_textbook() -> None:
    half, thin = np.array([[0.2, 0.2, 0.2]]), np.ones(1)
    assert unit_inertia("sphere", half, thin)[0] == pytest.approx([2 / 3 * 0.04] * 3)
    assert unit_inertia("cylinder", half, thin)[0, 2] == pytest.approx(0.04)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_a_hollow_body_has_its_inertia_in_mjcf(rng: np.random.Generator, shape: str) -> None:
    obj = replace(random_object(rng, shape), hollow=0.8)
    model = compile_xml(scene_xml(Scene((obj,), ground=None)))
    np.testing.assert_allclose(model.body_inertia[1], principal_moments(obj), rtol=1e-9)
    np.testing.assert_allclose(model.body_mass[1], obj.mass)
    assert "inertial" not in scene_xml(Scene((replace(obj, hollow=0.0),)))


@pytest.mark.parametrize("shape", SHAPES)
def test_no_point_of_a_body_is_lower_than_it_reaches_and_one_is_as_low(rng: np.random.Generator, shape: str) -> None:
    for _ in range(5):
        obj = random_object(rng, shape)
        lowest = rotate(np.array(obj.orientation), surface_points(rng, obj, 20000))[:, 2].min()
        assert -lowest <= reach_below(obj) + 1e-5
        assert -lowest > reach_below(obj) - 0.003


@pytest.mark.parametrize("shape", SHAPES)
def test_a_body_put_down_as_low_as_it_reaches_just_touches_the_ground(rng: np.random.Generator, shape: str) -> None:
    obj = random_object(rng, shape)
    for gap, touching in ((-0.002, True), (0.002, False)):
        scene = Scene((replace(obj, position=(0, 0, reach_below(obj) + gap)),))
        model = compile_xml(scene_xml(scene))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        assert (data.ncon > 0) == touching
        if touching:
            assert data.contact.dist.min() == pytest.approx(gap, abs=1e-4)
