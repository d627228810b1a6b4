"""Forecasts of frames that were not fitted."""

import pytest

from pipeline.discovery.filmed.unfitted import _recorded_over_true
from pipeline.scene.scene import Effect, Scene, SceneObject

BALL = SceneObject("sphere", (0.1,), 1.0, position=(0.0, 0.0, 1.0), name="ball")


def test_a_wrong_clock_and_a_wrong_ruler_change_what_a_forecast_is_compared_with():
    named = (Effect("clock_rate", (("ratio", 1.1),)), Effect("length_scale", (("ratio", 0.9),)))
    assert _recorded_over_true(Scene((BALL,), effects=named)) == pytest.approx((1.1, 0.9))
    assert _recorded_over_true(Scene((BALL,))) == (1.0, 1.0)
