import numpy as np
import pytest

from pipeline.vision.rendering.appearance import (
    Sensor,
    apply_sensor,
    plain_appearance,
    sample_appearance,
    sample_sensor,
)
from pipeline.vision.rendering.texture import TEXTURES


def test_the_same_seed_gives_the_same_appearance_and_another_seed_another() -> None:
    one, two, other = (sample_appearance(np.random.default_rng(s), 3) for s in (5, 5, 6))
    assert one == two
    assert one != other


@pytest.mark.parametrize("count", [0, 1, 6])
def test_there_is_one_material_for_each_object_with_valid_numbers(rng: np.random.Generator, count: int) -> None:
    for appearance in (sample_appearance(rng, count), plain_appearance(count)):
        assert len(appearance.materials) == count
        for material in (*appearance.materials, appearance.floor):
            assert material.texture in TEXTURES
            assert material.scale > 0
            assert all(0 <= c <= 1 for c in (*material.colour, *material.second_colour))
        assert appearance.lights


def test_only_textures_with_a_weight_are_drawn(rng: np.random.Generator) -> None:
    weights = {"stripes": 1.0, "plain": 0.0}
    drawn = sample_appearance(rng, 40, textures=weights, floor_textures={"noise": 2.0}, metal_probability=0.0)
    assert {m.texture for m in drawn.materials} == {"stripes"}
    assert drawn.floor.texture == "noise"
    assert all(m.mirror == 0 for m in drawn.materials)


def test_an_unknown_texture_is_named_with_those_that_are_valid(rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match=r"textures: \['zebra'\]; valid kinds are .*stripes"):
        sample_appearance(rng, 1, textures={"zebra": 1.0})


def test_an_ideal_sensor_changes_nothing(rng: np.random.Generator) -> None:
    frames = rng.integers(0, 256, (2, 10, 12, 3), dtype=np.uint8)
    np.testing.assert_array_equal(apply_sensor(frames, Sensor(), rng), frames)


def test_a_sensors_noise_has_the_stated_deviation(rng: np.random.Generator) -> None:
    grey = np.full((4, 60, 60, 3), 128, dtype=np.uint8)
    noisy = apply_sensor(grey, Sensor(noise=0.03), rng).astype(float)
    assert noisy.std() == pytest.approx(0.03 * 255, rel=0.05)
    assert noisy.mean() == pytest.approx(128, abs=0.5)


def test_a_sensor_with_a_seed_gives_the_same_pictures(rng: np.random.Generator) -> None:
    frames = rng.integers(0, 256, (2, 20, 20, 3), dtype=np.uint8)
    sensor = sample_sensor(rng)
    one, two = (apply_sensor(frames, sensor, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(one, two)
