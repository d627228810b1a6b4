import numpy as np
import pytest

from pipeline.vision.rendering.texture import PLAIN, TEXTURES, texture, value_noise

POINTS = 400


def sample(kind: int, points: np.ndarray, footprint: float = 0.001, seed: int = 3) -> np.ndarray:
    return np.array([texture(kind, 0.1, seed, *p, footprint) for p in points.tolist()])


@pytest.mark.parametrize("name", list(TEXTURES))
def test_a_texture_is_a_share_that_varies_unless_it_is_plain(rng: np.random.Generator, name: str) -> None:
    mix = sample(TEXTURES[name], rng.uniform(-0.5, 0.5, (POINTS, 3)))
    assert ((mix >= 0) & (mix <= 1)).all()
    assert mix.std() == 0 if name == "plain" else mix.std() > 0.1


@pytest.mark.parametrize("name", [n for n in TEXTURES if n != "plain"])
def test_a_texture_finer_than_a_pixel_is_grey(rng: np.random.Generator, name: str) -> None:
    np.testing.assert_allclose(sample(TEXTURES[name], rng.uniform(-1, 1, (POINTS, 3)), footprint=1.0), 0.5)


@pytest.mark.parametrize("name", [n for n in TEXTURES if n != "plain"])
def test_seeds_give_different_variants_and_the_same_seed_the_same(rng: np.random.Generator, name: str) -> None:
    points = rng.uniform(-0.5, 0.5, (POINTS, 3))
    first = sample(TEXTURES[name], points)
    np.testing.assert_array_equal(first, sample(TEXTURES[name], points))
    assert np.abs(first - sample(TEXTURES[name], points, seed=4)).mean() > 0.05


def test_value_noise_is_continuous(rng: np.random.Generator) -> None:
    for p in rng.uniform(-5, 5, (200, 3)):
        step = 1e-6 * rng.normal(size=3)
        assert abs(value_noise(*p, 1) - value_noise(*(p + step), 1)) < 1e-4


def test_value_noise_is_even_enough_not_to_shift_the_mean_colour(rng: np.random.Generator) -> None:
    values = [value_noise(*p, 9) for p in rng.uniform(-100, 100, (2000, 3))]
    assert abs(np.mean(values) - 0.5) < 0.03


def test_plain_shows_the_first_colour_only() -> None:
    assert texture(PLAIN, 0.1, 0, 0.3, 0.2, 0.1, 1.0) == 0
