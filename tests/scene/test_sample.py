from collections import Counter
from dataclasses import replace
from math import comb

import numpy as np
import pytest
from sampled_scenes import distribution

from pipeline.scene.canonical import DECIMALS, canonical_object, rounded_object, rounded_scene
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.sample import compositions, draw_composition, draw_scene
from pipeline.scene.scene import BASIC_SHAPES, Scene, SceneObject
from pipeline.scene.solid import reach_below
from pipeline.scene.text import read_scene, write_scene

HELD_OUT = ("box+box+box+sphere", "cylinder+cylinder+sphere+sphere")


def within(value: float, bounds: tuple[float, float], slack: float) -> bool:
    return bounds[0] - slack <= value <= bounds[1] + slack


def axis(obj: SceneObject) -> np.ndarray:
    return matrix_from_quaternion(np.array(obj.orientation))[:, 2]


def drawn(rng: np.random.Generator, count: int = 200) -> list[Scene]:
    return [draw_scene(rng, draw_composition(rng, {1: 1, 2: 1, 3: 1}), distribution()) for _ in range(count)]


def test_every_number_is_within_its_range(rng: np.random.Generator) -> None:
    d = distribution()
    sizes = {"sphere": (d.sphere_radius,), "cylinder": (d.cylinder_radius, d.cylinder_height), "box": (d.box_side,) * 3}
    for scene in drawn(rng):
        assert scene.camera is not None
        assert scene.camera.position[:2] == (0.0, -d.camera_distance)
        assert within(scene.camera.position[2], d.camera_height, 0.005)
        assert within(scene.camera.fov, d.camera_fov, 0.005)
        assert within(-scene.gravity[2], d.gravity, 0.005)
        for obj in scene.objects:
            assert all(within(v, r, 0.0005) for v, r in zip(obj.size, sizes[obj.shape], strict=True))
            for key in ("mass", "sliding_friction", "rolling_friction", "damping"):
                assert within(getattr(obj, key), getattr(d, key), 0.005)
            assert within(obj.position[0], d.x, 0.0005)
            assert within(obj.position[1], d.y, 0.0005)
            assert within(float(np.hypot(*obj.velocity[:2])), d.speed, 0.01)


def test_no_body_starts_inside_the_ground_and_most_lie_on_it(rng: np.random.Generator) -> None:
    d = distribution()
    gaps = np.array([o.position[2] - reach_below(o) for s in drawn(rng) for o in s.objects])
    assert gaps.min() >= -1e-6
    assert gaps.max() <= d.drop_height[1] + 0.001
    on_it = (gaps < 0.0011).mean()
    assert on_it == pytest.approx(1 - d.airborne, abs=5 * np.sqrt(d.airborne * (1 - d.airborne) / len(gaps)))


def test_bodies_that_start_to_roll_do_so_without_slip(rng: np.random.Generator) -> None:
    d = replace(distribution(), rolling=1.0, airborne=0.0, lying=1.0)
    for shape in ("sphere", "cylinder"):
        for _ in range(20):
            (obj,) = draw_scene(rng, [shape], d).objects
            slip = np.array(obj.velocity) + np.cross(obj.angular_velocity, [0, 0, -obj.size[0]])
            if shape == "cylinder":  # which cannot roll along its axis
                slip -= (slip @ axis(obj)) * axis(obj)
            np.testing.assert_allclose(slip, 0, atol=0.01)


def extent(obj: SceneObject) -> np.ndarray:
    """A symmetric matrix (3, 3) that says how far a body reaches each way: the same whichever axis comes first."""
    sides = {1: (0, 0, 0), 2: (0, 0, 1), 3: (0, 1, 2)}[len(obj.size)]
    turn = matrix_from_quaternion(np.array(obj.orientation))
    return turn @ np.diag(np.array(obj.size)[list(sides)] ** 2) @ turn.T


def test_drawn_scenes_are_canonical_and_rounded_and_read_back(rng: np.random.Generator) -> None:
    for scene in drawn(rng, 50):
        assert rounded_scene(scene) == scene
        assert read_scene(write_scene(scene)) == scene
        for obj in scene.objects:
            # Rounding may make another orientation of the same body the canonical one, where two are equally near.
            again = canonical_object(obj)
            np.testing.assert_allclose(sorted(again.size), sorted(obj.size))
            np.testing.assert_allclose(extent(again), extent(obj), atol=0.001)
            assert again.orientation[0] == pytest.approx(obj.orientation[0], abs=0.002)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_compositions_are_all_multisets_of_the_shapes(count: int) -> None:
    found = compositions(count)
    assert len(set(found)) == len(found) == comb(count + 2, 2)
    assert all(len(c) == count and set(c) <= set(BASIC_SHAPES) for c in found)


def test_compositions_are_drawn_evenly_and_held_out_ones_never(rng: np.random.Generator) -> None:
    counts = Counter(draw_composition(rng, {3: 1.0, 4: 3.0}, without=HELD_OUT) for _ in range(4000))
    assert not {"+".join(c) for c in counts} & set(HELD_OUT)
    assert len(counts) == len(compositions(3)) + len(compositions(4)) - len(HELD_OUT)
    fours = sum(n for c, n in counts.items() if len(c) == 4)
    assert fours / 4000 == pytest.approx(0.75, abs=0.04)


def test_only_the_compositions_asked_for_are_drawn(rng: np.random.Generator) -> None:
    counts = {"+".join(draw_composition(rng, {4: 1}, only=HELD_OUT)) for _ in range(50)}
    assert counts == set(HELD_OUT)


def test_rounding_keeps_the_decimals_of_each_number(rng: np.random.Generator) -> None:
    obj = SceneObject(
        "box", tuple(rng.uniform(0.1, 1, 3)), 1.23456, *rng.uniform(0, 1, 3), orientation=(1, 0.2, 0.3, 0.4)
    )
    rounded = rounded_object(obj)
    for key, decimals in DECIMALS.items():
        if "camera" not in key and key not in ("gravity", "orientation"):
            values = np.atleast_1d(getattr(rounded, key))
            np.testing.assert_allclose(values, np.round(values, decimals), atol=1e-9)
            np.testing.assert_allclose(values, np.atleast_1d(getattr(obj, key)), atol=0.51 * 10**-decimals)
    assert rounded_object(rounded) == rounded
