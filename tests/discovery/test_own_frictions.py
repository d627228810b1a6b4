"""Slides whose friction differs, and effects that must not be hidden by what slides leave."""

import numpy as np
import pytest
from small_world import KNOWN, effect, thrown

from pipeline.discovery.discover import discover
from pipeline.discovery.fitting.calibration import calibrate
from pipeline.discovery.fitting.extension import extend
from pipeline.discovery.selection.touched import touched
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import FRICTION_SIGMA, build_problem, with_friction_nuisance
from pipeline.discovery.tracks.track import Track
from pipeline.scene.effects.registry import effect_kinds

SIDE, G, NOISE, RATE = 0.1, 9.81, 2e-4, 100
CUBE = {"objects": [{"name": "cube", "shape": "box", "width": SIDE, "depth": SIDE, "height": SIDE, "mass": 0.4}]}


def slides(rng: np.random.Generator, frictions: np.ndarray) -> list[Track]:
    """Slides of a cube on a level ground until it rests: x = v t - mu g t² / 2."""
    out = []
    for i, mu in enumerate(frictions):
        speed, angle, t = rng.uniform(0.7, 1.0), rng.uniform(0, 2 * np.pi), np.arange(60) / RATE
        moving = np.minimum(t, speed / (mu * G))
        way = speed * moving - mu * G * moving**2 / 2
        x = np.column_stack([way * np.cos(angle), way * np.sin(angle), np.full(len(t), SIDE / 2)])
        out.append(Track(f"slide_{i}", "cube", t, x + rng.normal(0, NOISE, x.shape), np.tile([1.0, 0, 0, 0], (60, 1))))
    return out


def flights(rng: np.random.Generator, gravity: float, clips: int) -> list[Track]:
    """Throws of a cube that does not turn."""
    out = []
    for i in range(clips):
        t, v = np.arange(30) / RATE, np.array([*rng.normal(0, 1, 2), rng.uniform(0, 1)])
        x = np.array([0, 0, 1.0]) + v * t[:, None] - 0.5 * gravity * np.array([0, 0, 1.0]) * t[:, None] ** 2
        out.append(Track(f"flight_{i}", "cube", t, x + rng.normal(0, NOISE, x.shape), np.tile([1.0, 0, 0, 0], (30, 1))))
    return out


def test_each_slide_has_the_friction_that_it_moved_with(rng: np.random.Generator) -> None:
    frictions = 0.2 * (1 + rng.uniform(-0.1, 0.1, 8))
    problem = with_friction_nuisance(build_problem(slides(rng, frictions), known_scene(CUBE), 0.0, rng))
    found = calibrate(problem).none.fit
    (stack,), (start,) = problem.stacks, found.starts
    assert stack.friction_sigma == FRICTION_SIGMA
    np.testing.assert_allclose(
        found.theta[0] * (1 + start[:, 10]), frictions[[int(c.split("_")[1]) for c in stack.clip]], rtol=0.01
    )


def test_a_ball_that_rolls_has_no_friction_of_its_own(rng: np.random.Generator) -> None:
    problem = build_problem(thrown(rng, 2), known_scene(KNOWN), 0.0, rng)
    assert all(stack.friction_sigma == 0 for stack in with_friction_nuisance(problem).stacks)


def test_gravity_touches_heights_in_flight_alone() -> None:
    rng = np.random.default_rng(2)  # holds out some of both
    tracks = [*slides(rng, np.full(4, 0.2)), *flights(rng, 9.6, 4)]
    problem = build_problem(tracks, known_scene(CUBE), 0.5, rng)
    calibration = calibrate(problem)
    (found,) = extend(calibration, calibration.none, [effect_kinds()["gravity_error"]], lambda _: None)
    where = touched(calibration.none, found, NOISE)
    in_air = [not stack.grounded for stack in problem.stacks]
    np.testing.assert_array_equal(where.axes[in_air], [[False, False, True]])
    assert where.left(found) < 0.3 * where.left(calibration.none)


def test_two_effects_are_found_although_the_noise_floor_cannot_follow_a_blow() -> None:
    rng = np.random.default_rng(3)
    effects = (effect("tilted_gravity", tilt=(0.02, -0.01)), effect("impulse", time=0.47, momentum=(0.02, -0.006, 0.0)))
    found = discover(thrown(rng, 10, effects), known_scene(KNOWN), 0.3, tuple(effect_kinds()), rng)
    assert set(found.verdict.effects) == {"tilted_gravity", "impulse"}
    assert found.gap.after == pytest.approx(0.002, rel=0.1)
