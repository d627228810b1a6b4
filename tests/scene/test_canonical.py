from dataclasses import replace

import numpy as np
import pytest

from pipeline.physics.simulate import simulate
from pipeline.scene.canonical import CUBE_ROTATIONS, canonical_object
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import SIZE_KEYS, Camera, Scene, SceneObject, half_extents
from pipeline.scene.solid import unit_inertia
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise

SHAPES = [s for s in SIZE_KEYS if s != "mesh"]
CAMERA = Camera((0, -2, 1), 40, pitch=-20)


def random_object(rng: np.random.Generator, shape: str) -> SceneObject:
    size = rng.uniform(0.1, 0.4, len(SIZE_KEYS[shape]))
    if shape == "capsule":
        size[1] += 2 * size[0]
    return SceneObject(
        shape,
        tuple(size),
        1.0,
        position=(0.1, 0, 0.5),
        orientation=tuple(rng.normal(size=4)),
        velocity=(0.3, 0.2, 1.0),
        angular_velocity=tuple(rng.normal(size=3)),
    )


def inertia_world(obj: SceneObject) -> np.ndarray:
    turn = matrix_from_quaternion(np.array(obj.orientation))
    return turn @ np.diag(unit_inertia(obj.shape, half_extents(obj)[None], np.array([obj.hollow]))[0]) @ turn.T


@pytest.mark.parametrize("shape", SHAPES)
def test_the_canonical_description_is_of_the_same_body(rng: np.random.Generator, shape: str) -> None:
    for _ in range(20):
        obj = random_object(rng, shape)
        same = canonical_object(obj)
        assert sorted(same.size) == sorted(obj.size)
        np.testing.assert_allclose(inertia_world(same), inertia_world(obj), atol=1e-6)
        masks = [
            rasterise((o,), np.array([[o.position]]), np.array([[o.orientation]]), pinhole(CAMERA), 120, 80).mask
            for o in (obj, same)
        ]
        assert (masks[0] != masks[1]).sum() <= 2  # orientations have six digits


@pytest.mark.parametrize("shape", SHAPES)
def test_the_canonical_description_moves_alike(rng: np.random.Generator, shape: str) -> None:
    obj = random_object(rng, shape)
    first, second = (simulate(Scene((o,)), 0.25) for o in (obj, canonical_object(obj)))
    np.testing.assert_allclose(first.position, second.position, atol=1e-5)
    np.testing.assert_allclose(first.angular_velocity, second.angular_velocity, atol=1e-3)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_canonical_description_is_its_own(rng: np.random.Generator, shape: str) -> None:
    for _ in range(20):
        once = canonical_object(random_object(rng, shape))
        twice = canonical_object(once)
        np.testing.assert_allclose(twice.size, once.size)
        np.testing.assert_allclose(twice.orientation, once.orientation, atol=2e-6)


def test_all_equal_descriptions_of_a_box_have_one_canonical_form(rng: np.random.Generator) -> None:
    obj = random_object(rng, "box")
    turn = matrix_from_quaternion(np.array(obj.orientation))
    wanted = canonical_object(obj)
    for rotation in matrix_from_quaternion(CUBE_ROTATIONS):
        matrix = turn @ rotation
        size = np.abs(rotation.T) @ obj.size
        w = np.sqrt(max(0.0, 1 + np.trace(matrix))) / 2
        if w < 0.1:
            continue  # this way to a quaternion needs a turn of less than half a circle
        parts = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / (
            4 * w
        )
        other = canonical_object(replace(obj, size=tuple(size), orientation=(w, *parts)))
        np.testing.assert_allclose(other.size, wanted.size, atol=1e-5)
        np.testing.assert_allclose(other.orientation, wanted.orientation, atol=1e-4)


def test_no_turn_of_a_box_is_smaller_than_the_canonical_one(rng: np.random.Generator) -> None:
    for _ in range(100):
        w = canonical_object(random_object(rng, "box")).orientation[0]
        assert 2 * np.degrees(np.arccos(min(w, 1.0))) < 62.8  # the farthest turn from the cube's 24 (Mackenzie 1958)
    for yaw in np.radians(np.arange(-170, 180, 20)):
        standing = SceneObject("box", (0.1, 0.2, 0.3), 1.0, orientation=(np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)))
        turn = canonical_object(standing).orientation
        assert turn[1] == turn[2] == 0
        assert 2 * abs(np.degrees(np.arcsin(turn[3]))) <= 45.001


def test_a_sphere_is_not_turned_and_a_cylinder_not_about_its_axis(rng: np.random.Generator) -> None:
    assert canonical_object(random_object(rng, "sphere")).orientation == (1.0, 0.0, 0.0, 0.0)
    for _ in range(20):
        can = canonical_object(random_object(rng, "cylinder"))
        assert can.orientation[3] == 0
        assert matrix_from_quaternion(np.array(can.orientation))[2, 2] > -1e-6
    standing = SceneObject("cylinder", (0.1, 0.2), 1.0, orientation=(0.6, 0, 0, 0.8))
    assert canonical_object(standing).orientation == (1.0, 0.0, 0.0, 0.0)
    upside_down = SceneObject("cylinder", (0.1, 0.2), 1.0, orientation=(0, 1, 0, 0))
    assert canonical_object(upside_down).orientation == (1.0, 0.0, 0.0, 0.0)
