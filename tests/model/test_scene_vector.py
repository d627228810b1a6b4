"""Scenes as vectors of fixed length."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import distribution, draw

from pipeline.model.scene_vector import (
    CLASSES,
    ORIENTATION,
    POSITION,
    SLOT,
    SLOTS,
    decode,
    encode,
    likeliest_shapes,
    scale_of,
)
from pipeline.scene.sample import Distribution, draw_scene
from pipeline.scene.scene import BASIC_SHAPES
from pipeline.scene.solid import reach_below
from pipeline.scene.text import read_scene, write_scene

SCALE = scale_of(distribution())


def random_shapes(rng: np.random.Generator) -> list[str]:
    return [str(s) for s in rng.choice(BASIC_SHAPES, int(rng.integers(1, SLOTS + 1)))]


def test_a_scene_comes_back_from_its_vector(rng: np.random.Generator) -> None:
    kept = draw(int(rng.integers(2**31)), range(4)).scenes
    for scene in [*kept, *(draw_scene(rng, random_shapes(rng), distribution()) for _ in range(300))]:
        vector = encode(scene, SCALE)
        assert decode(vector.head, vector.shapes, vector.numbers, SCALE) == scene


def test_what_is_sampled_lies_between_0_and_1(rng: np.random.Generator) -> None:
    for _ in range(300):
        vector = encode(draw_scene(rng, random_shapes(rng), distribution()), SCALE)
        for numbers in (vector.head, vector.numbers):
            assert numbers.min() > -0.01
            assert numbers.max() < 1.01


def test_slots_are_in_the_order_of_the_text_and_empty_ones_follow(rng: np.random.Generator) -> None:
    shapes = random_shapes(rng)
    scene = draw_scene(rng, shapes, distribution())
    vector = encode(scene, SCALE)
    assert [CLASSES[k] for k in vector.shapes] == shapes + [None] * (SLOTS - len(shapes))
    assert (
        vector.present.sum(1)
        == [{"sphere": 14, "cylinder": 18, "box": 20}[s] for s in shapes] + [0] * (SLOTS - len(shapes))
    ).all()
    x = vector.numbers[: len(shapes), POSITION.start]
    low, high = distribution().x
    np.testing.assert_allclose(low + x * (high - low), [o.position[0] for o in scene.objects])


@pytest.mark.parametrize("spread", [0.0, 1.0, 100.0])
def test_any_vector_is_a_valid_scene_with_no_object_in_the_ground(rng: np.random.Generator, spread: float) -> None:
    for _ in range(50):
        shapes = likeliest_shapes(rng.normal(size=(SLOTS, len(CLASSES))))
        head, numbers = rng.uniform(-spread, 1 + spread, 4), rng.uniform(-spread, 1 + spread, (SLOTS, len(SLOT)))
        scene = decode(head, shapes, numbers, SCALE)
        assert read_scene(write_scene(scene)) == scene
        assert scene.shapes == tuple(CLASSES[k] for k in shapes if k)
        for obj in scene.objects:
            assert obj.position[2] >= reach_below(obj) - 1e-6
            assert np.linalg.norm(obj.orientation) == pytest.approx(1, abs=1e-4)


def test_there_is_always_an_object_the_likeliest_one(rng: np.random.Generator) -> None:
    logits = rng.normal(size=(SLOTS, len(CLASSES)))
    logits[:, 0] = 10
    slot, kind = int(rng.integers(SLOTS)), int(rng.integers(1, len(CLASSES)))
    logits[slot, kind] = 9
    shapes = likeliest_shapes(logits)
    assert np.count_nonzero(shapes) == 1
    assert shapes[slot] == kind


def test_a_range_of_one_number_is_that_number(rng: np.random.Generator) -> None:
    fixed: Distribution = replace(distribution(), gravity=(9.81, 9.81), sphere_radius=(0.1, 0.1))
    scene = draw_scene(rng, ["sphere", "box"], fixed)
    vector = encode(scene, scale_of(fixed))
    assert decode(vector.head, vector.shapes, vector.numbers, scale_of(fixed)) == scene
    told = decode(rng.random(4), vector.shapes, rng.random((SLOTS, len(SLOT))), scale_of(fixed))
    assert told.gravity[2] == -9.81
    assert told.objects[0].size == (0.1,)
    assert ORIENTATION.stop == len(SLOT)
