from dataclasses import replace

import numpy as np
import pytest

from pipeline.physics.overlap import penetration
from pipeline.scene.scene import SIZE_KEYS, Scene, SceneObject
from pipeline.scene.solid import reach_below

SHAPES = [s for s in SIZE_KEYS if s != "mesh"]


def ball(x: float, y: float = 0.0, z: float = 1.0, r: float = 0.1) -> SceneObject:
    return SceneObject("sphere", (r,), 1.0, position=(x, y, z))


def test_balls_overlap_by_their_radii_less_the_distance(rng: np.random.Generator) -> None:
    a, b = rng.uniform(0.05, 0.3, 2).round(3)
    depth = rng.uniform(0.001, 0.04)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    other = tuple(direction * (a + b - depth) + [0, 0, 1])
    assert penetration(Scene((ball(0, r=a), ball(*other, r=b)))) == pytest.approx(depth, abs=1e-5)


def test_the_worst_pair_counts() -> None:
    balls = [ball(0), ball(0.19), ball(0.36), ball(1.0), ball(1.2)]
    assert penetration(Scene(tuple(balls))) == pytest.approx(0.03, abs=1e-6)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_ball_in_a_box_overlaps_by_the_depth_of_its_surface(order: tuple[int, int]) -> None:
    objects = [ball(0, 0, 1.24), SceneObject("box", (0.4, 0.4, 0.3), 1.0, position=(0, 0, 1.0))]
    assert penetration(Scene(tuple(objects[i] for i in order))) == pytest.approx(0.01, abs=1e-5)


@pytest.mark.parametrize(
    ("first", "second"),
    [("box", "box"), ("box", "cylinder"), ("cylinder", "cylinder"), ("capsule", "box"), ("ellipsoid", "sphere")],
)
def test_stacked_bodies_overlap_by_what_their_heights_exceed_their_distance(first: str, second: str) -> None:
    size = {
        "box": (0.3, 0.3, 0.2),
        "cylinder": (0.15, 0.2),
        "capsule": (0.05, 0.2),
        "ellipsoid": (0.2, 0.2, 0.2),
        "sphere": (0.1,),
    }
    depth = 0.008
    low = SceneObject(first, size[first], 1.0, position=(0, 0, 0.5))
    high = SceneObject(second, size[second], 1.0, position=(0, 0, 0.7 - depth))
    assert penetration(Scene((low, high))) == pytest.approx(depth, abs=2e-4)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_body_in_the_ground_overlaps_by_how_deep_it_reaches(rng: np.random.Generator, shape: str) -> None:
    size = (0.1, 0.3) if shape == "capsule" else (0.2,) * len(SIZE_KEYS[shape])
    obj = SceneObject(shape, size, 1.0, orientation=tuple(rng.normal(size=4)))
    level = rng.uniform(-1, 1)
    deep = replace(obj, position=(0, 0, level + reach_below(obj) - 0.02))
    assert penetration(Scene((deep,), ground=level)) == pytest.approx(0.02, abs=1e-5)
    assert penetration(Scene((deep,), ground=None)) == 0


def test_bodies_apart_do_not_overlap(rng: np.random.Generator) -> None:
    shapes = rng.choice(["sphere", "box", "cylinder"], 4)
    objects = tuple(
        SceneObject(str(s), (0.2,) * len(SIZE_KEYS[s]), 1.0, position=(i, 0, 1), orientation=tuple(rng.normal(size=4)))
        for i, s in enumerate(shapes)
    )
    assert penetration(Scene(objects)) == 0
    assert penetration(Scene(())) == 0


def test_one_scenes_sizes_do_not_linger_in_the_next() -> None:
    big = Scene((ball(0, r=0.3), ball(0.4, r=0.3)))
    small = Scene((ball(0, r=0.1), ball(0.4, r=0.1)))
    assert penetration(big) == pytest.approx(0.2)
    assert penetration(small) == 0
    assert penetration(big) == pytest.approx(0.2)
