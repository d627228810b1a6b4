"""Models are fitted again with another clip held out."""

from dataclasses import replace

import numpy as np
import pytest
from small_world import KNOWN, effect, thrown

from pipeline.discovery.fitting.calibration import calibrate
from pipeline.discovery.fitting.extension import extend
from pipeline.discovery.fitting.other_split import hold_out_instead
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import Problem, build_problem
from pipeline.discovery.tracks.track import Track
from pipeline.scene.effects.registry import effect_kinds


def problem_of(rng: np.random.Generator) -> Problem:
    tracks = thrown(rng, 5, (effect("air_drag", coefficient=0.01),))
    return build_problem(tracks, known_scene(KNOWN), 0.3, rng)


def test_each_clip_in_turn_is_held_out_and_all_others_are_fitted(rng: np.random.Generator) -> None:
    calibration = calibrate(problem_of(rng))
    (drag,) = extend(calibration, calibration.none, [effect_kinds()["air_drag"]], lambda _: None)
    for clip in sorted(calibration.problem.clips):
        found = hold_out_instead(calibration, [calibration.none, drag], clip)
        assert found is not None
        again, (none, with_drag) = found
        assert again.problem.held_out == with_drag.problem.held_out == (clip,)
        assert {*again.problem.fitted, clip} == {*calibration.problem.clips}
        assert with_drag.held_out < 0.5 * none.held_out
        assert with_drag.fit.theta[0] == pytest.approx(0.01, rel=0.1)


def test_what_is_held_out_does_not_change_the_fit(rng: np.random.Generator) -> None:
    problem = problem_of(rng)
    calibration = calibrate(problem)
    (clip, *_) = problem.fitted
    stacks = []
    for stack in problem.stacks:
        spoilt_arcs = np.array([problem.arcs[i].clip == clip for i in stack.index])
        drift = spoilt_arcs[:, None, None] * stack.time[..., None] ** 2 * [0.0, 0.0, 1.0]
        stacks.append(replace(stack, position=stack.position + drift))
    spoilt = calibrate(replace(problem, stacks=tuple(stacks)))
    before, fits = [], []
    for own in (calibration, spoilt):
        (drag,) = extend(own, own.none, [effect_kinds()["air_drag"]], lambda _: None)
        before.append(drag.fit.theta[0])
        found = hold_out_instead(own, [drag], clip)
        assert found is not None
        fits.append(found[1][0].fit.theta[0])
    assert before[0] != pytest.approx(before[1], rel=0.03)
    assert fits[0] == pytest.approx(fits[1], rel=0.01)


def test_a_single_clip_cannot_be_forecast_by_others(rng: np.random.Generator) -> None:
    track: list[Track] = thrown(rng, 1)
    calibration = calibrate(build_problem(track, known_scene(KNOWN), 0.3, rng))
    assert hold_out_instead(calibration, [calibration.none], "clip_0") is None
