"""Outlines of known shape registered to masks."""

import numpy as np

from pipeline.discovery.filmed.registration import register_outline

ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], 1)


def discs(*parts: tuple[float, float, float]) -> np.ndarray:
    """A mask (80, 120) of discs x, y, radius, px."""
    y, x = np.mgrid[:80, :120] + 0.5
    return np.any([(x - a) ** 2 + (y - b) ** 2 < r * r for a, b, r in parts], axis=0)


def test_a_disc_is_found_to_a_tenth_of_a_pixel() -> None:
    found = register_outline(discs((52.3, 40.8, 12.4)), 11.0 * CIRCLE)
    assert found is not None
    np.testing.assert_allclose(found.centre, [52.3, 40.8], atol=0.1)
    assert abs(11.0 * found.scale - 12.4) < 0.15


def test_a_shadow_that_hangs_on_a_ball_moves_its_centre_by_less_than_half_a_pixel() -> None:
    mask = discs((52.3, 40.8, 12.4), (60.0, 48.0, 8.0))
    found = register_outline(mask, 12.4 * CIRCLE)
    assert found is not None
    y, x = np.nonzero(mask)
    assert np.linalg.norm([x.mean() + 0.5 - 52.3, y.mean() + 0.5 - 40.8]) > 1.5
    assert np.linalg.norm(found.centre - [52.3, 40.8]) < 0.5
    assert abs(12.4 * found.scale - 12.4) < 0.6


def test_a_shape_that_does_not_fit_is_not_registered() -> None:
    mask = np.zeros((80, 120), bool)
    mask[30:34, 10:110] = True
    assert register_outline(mask, 12.4 * CIRCLE) is None


def test_a_known_scale_is_kept() -> None:
    found = register_outline(discs((52.3, 40.8, 12.4)), 12.4 * CIRCLE, (np.array([54.0, 42.0]), 0.98))
    assert found is not None and found.scale == 0.98
    np.testing.assert_allclose(found.centre, [52.3, 40.8], atol=0.2)
