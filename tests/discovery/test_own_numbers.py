"""Objects that were recorded one by one, each with its own numbers of a law."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from small_world import KNOWN, effect, thrown

from pipeline.discovery.fitting.calibration import calibrate
from pipeline.discovery.fitting.estimates import effect_estimates
from pipeline.discovery.fitting.extension import extend
from pipeline.discovery.selection.established import _harms_a_body
from pipeline.discovery.selection.gap import body_gap
from pipeline.discovery.tracks.known_scene import KnownScene, known_scene
from pipeline.discovery.tracks.problem import Problem, build_problem, recorded_alone
from pipeline.discovery.tracks.track import Track
from pipeline.scene.effects.registry import effect_kinds

DRAG = {"light": 0.02, "heavy": 0.001}


def balls(rng: np.random.Generator, clips: int = 4) -> tuple[list[Track], KnownScene]:
    """Throws of two balls, one in each clip."""
    tracks = [
        replace(t, clip=f"{name}_{t.clip}", object=name, angular_velocity=None)
        for name, coefficient in DRAG.items()
        for t in thrown(rng, clips, (effect("air_drag", coefficient=coefficient),))
    ]
    return tracks, known_scene({"objects": [{**KNOWN["objects"][0], "name": name} for name in DRAG]})


def problem(rng: np.random.Generator, clips: int = 4) -> Problem:
    return build_problem(*balls(rng, clips), 0.3, rng)


def test_each_ball_has_its_own_drag_within_its_standard_errors() -> None:
    calibration = calibrate(problem(np.random.default_rng(1)))
    (found,) = extend(calibration, calibration.none, [effect_kinds()["air_drag"]], lambda _: None)
    numbers = effect_estimates(found, "air_drag")
    assert numbers.keys() == {"light.coefficient", "heavy.coefficient"}
    for name, true in DRAG.items():
        value, stderr = numbers[f"{name}.coefficient"].value, numbers[f"{name}.coefficient"].stderr
        assert isinstance(stderr, float) and value == pytest.approx(true, abs=5 * stderr) and stderr < 0.002


def test_a_ruler_is_common_to_all_objects() -> None:
    calibration = calibrate(problem(np.random.default_rng(2)))
    (found,) = extend(calibration, calibration.none, [effect_kinds()["length_scale"]], lambda _: None)
    assert found.fit.model.size == calibration.none.fit.model.size + 1


def test_a_ruler_that_suits_light_balls_only_is_not_established() -> None:
    calibration = calibrate(problem(np.random.default_rng(3)))
    none = calibration.none
    found: Any = SimpleNamespace(problem=calibration.problem, measured=calibration.problem, baseline=none)
    kinds = [effect_kinds()[name] for name in ("length_scale", "air_drag")]
    models = {c.name: c for c in extend(calibration, none, kinds, lambda _: None)}
    assert body_gap(models["length_scale"], 0) < body_gap(none, 0)
    assert _harms_a_body(found, models["length_scale"], none)
    assert not _harms_a_body(found, models["air_drag"], none)


@pytest.mark.parametrize("seed", range(20))
def test_every_object_is_in_a_fitted_clip(seed: int) -> None:
    made = problem(np.random.default_rng(seed), clips=2)
    assert recorded_alone(made) == (0, 1)
    assert made.held_out and {name.split("_")[0] for name in made.fitted} == set(DRAG)
