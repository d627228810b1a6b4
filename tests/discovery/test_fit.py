"""Arcs, noise and fits obey what they are for."""

from dataclasses import replace

import numpy as np
import pytest
from small_world import KNOWN, NOISE, effect, thrown

from pipeline.discovery.fitting.initial_states import initial_states
from pipeline.discovery.fitting.least_squares import fit
from pipeline.discovery.fitting.model import known_model, with_effect
from pipeline.discovery.fitting.predictions import SPIN_SCALE, run
from pipeline.discovery.fitting.screening import ScreeningRegression
from pipeline.discovery.fitting.velocity_jump_hits import velocity_jump_hits
from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.cutting import cut_tracks
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.noise import leave_one_out, rough_sigma
from pipeline.discovery.tracks.problem import build_problem, with_length_scale_nuisance
from pipeline.discovery.tracks.track import Track
from pipeline.discovery.tracks.velocity_jumps import VelocityJump, find_velocity_jumps
from pipeline.errors import MeasurementError
from pipeline.scene.effects.registry import effect_kinds


def test_noise_is_found_at_irregular_times_with_outliers_in_between(rng: np.random.Generator) -> None:
    t = np.cumsum(rng.uniform(0.01, 0.02, 400))
    x = np.stack([2 * t, np.sin(t), 5 - 4.9 * t**2], 1) + rng.normal(0, 0.003, (400, 3))
    x[::50] += 1.0
    assert rough_sigma(leave_one_out(t, x)) == pytest.approx(0.003, rel=0.3)


def test_a_bounce_is_a_break_and_a_parabola_has_none(rng: np.random.Generator) -> None:
    t = np.arange(60) / 60
    smooth = np.stack([t, 0 * t, 3 * t - 4.9 * t**2], 1) + rng.normal(0, NOISE, (60, 3))
    assert find_velocity_jumps(t, smooth, NOISE) == []
    kinked = smooth + np.maximum(0, t - 0.505)[:, None] * [0.0, 0.0, 4.0]
    (found,) = find_velocity_jumps(t, kinked, NOISE)
    assert found.time == pytest.approx(0.505, abs=0.01)
    standard_error = np.linalg.norm(found.change) / found.z
    assert np.abs(found.change - [0, 0, 4]).max() < 5 * standard_error < 1.5


def test_an_object_that_the_scene_lacks_is_named(rng: np.random.Generator) -> None:
    track = Track("c", "cube", np.arange(10) / 60, rng.normal(size=(10, 3)))
    with pytest.raises(MeasurementError, match="clip c, object cube, row 1: the scene has no such object; valid: ball"):
        cut_tracks([track], known_scene(KNOWN))


def test_single_outliers_are_left_out_and_good_samples_are_not(rng: np.random.Generator) -> None:
    tracks = thrown(rng, 3)
    tracks[1].position[[11, 40]] += [0.3, 0, 0.2]
    cut = cut_tracks(tracks, known_scene(KNOWN))
    assert {("clip_1", 0, 11), ("clip_1", 0, 40)} <= cut.outliers and len(cut.outliers) <= 4


def test_a_fit_finds_the_coefficient_within_its_standard_errors(rng: np.random.Generator) -> None:
    known = known_scene(KNOWN)
    problem = build_problem(thrown(rng, 8, (effect("air_drag", coefficient=0.004),)), known, 0.0, rng)
    model = with_effect(known_model(known, problem.stacks), effect_kinds()["air_drag"], known)
    found = fit(problem.stacks, model, model.start, initial_states(problem), problem.chosen)
    assert abs(found.theta[0] - 0.004) < 4 * found.covariance[0, 0] ** 0.5
    assert found.total(problem.chosen) == pytest.approx(problem.rows - 6 * 8, rel=0.12)


def test_chi_squared_never_rises_during_a_fit(rng: np.random.Generator) -> None:
    known = known_scene(KNOWN)
    problem = build_problem(thrown(rng, 4, (effect("linear_drag", coefficient=0.1),)), known, 0.0, rng)
    model = with_effect(known_model(known, problem.stacks), effect_kinds()["linear_drag"], known)
    begin = initial_states(problem)
    fits = [fit(problem.stacks, model, model.start, begin, problem.chosen, iterations=n) for n in (1, 2, 4)]
    totals = [found.total(problem.chosen) for found in fits]
    assert totals[0] >= totals[1] - 1e-6 >= totals[2] - 2e-6


def test_heights_alone_give_the_drag_and_nothing_across(rng: np.random.Generator) -> None:
    mass, k, tracks = 0.27, 0.0042, []
    for clip in range(2):
        t = np.cumsum(rng.uniform(0.06, 0.07, 45))
        fine = np.linspace(0, t[-1], 4000)
        speed = np.sqrt(9.81 * mass / k) * np.tanh(np.sqrt(9.81 * k / mass) * fine)
        fallen = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
        z = 48 - np.interp(t, fine, fallen) + rng.normal(0, 0.03, len(t))
        tracks.append(Track(f"drop_{clip}", "ball", t, np.column_stack([0 * z, 0 * z, z])))
    known = known_scene({"ground": None, "objects": [{"name": "ball", "shape": "sphere", "radius": 0.1, "mass": mass}]})
    problem = build_problem(tracks, known, 0.0, rng)
    model = with_effect(known_model(known, problem.stacks), effect_kinds()["air_drag"], known)
    found = fit(problem.stacks, model, model.start, initial_states(problem), problem.chosen)
    assert found.theta[0] == pytest.approx(k, rel=0.05)
    assert np.abs(found.starts[0][:, 3:5]).max() < 1e-6


def test_clips_with_exact_lengths_keep_them_and_stretched_ones_show(rng: np.random.Generator) -> None:
    tracks = thrown(rng, 4, spin=False)
    stretched = [replace(t, position=t.position * s) for t, s in zip(tracks, (0.97, 1.0, 1.0, 1.03), strict=True)]
    known = known_scene(KNOWN)
    problem = with_length_scale_nuisance(build_problem(stretched, known, 0.0, rng))
    model = known_model(known, problem.stacks)
    found = fit(problem.stacks, model, model.start, initial_states(problem), problem.chosen)
    order = np.argsort(problem.stacks[0].clip)
    np.testing.assert_allclose(found.starts[0][order, 9], [-0.03, 0, 0, 0.03], atol=0.006)
    plain = fit(
        [replace(s, length_scale_sigma=0.0) for s in problem.stacks],
        model,
        model.start,
        initial_states(problem),
        problem.chosen,
    )
    assert found.total(problem.chosen) < plain.total(problem.chosen) - 100


def test_one_hit_tells_where_an_obstacle_is_but_not_how_large(rng: np.random.Generator) -> None:
    jump = VelocityJump(0.5, np.array([1.0, 0.0, 3.0]), np.array([-4.0, 0.0, 0.0]), 60.0)
    t = np.arange(61) / 60
    x = np.column_stack([1.0 + np.where(t < 0.5, 2.0, -2.0) * (t - 0.5), 0 * t, 3 + 0 * t])
    arc = Arc(
        clip="clip",
        object=0,
        grounded=False,
        time=t,
        position=x,
        sigma=np.full(61, 0.002),
        row=np.arange(61),
        others=np.zeros((61, 0, 3)),
        jumps=(jump,),
    )
    problem = replace(build_problem(thrown(rng, 2), known_scene(KNOWN), 0.0, rng), arcs=(arc,))
    hits, rules = velocity_jump_hits(problem), effect_kinds()["hidden_obstacle"].discovery
    assert hits is not None and rules.fit_hits is not None
    found = rules.fit_hits(hits)
    assert found.count == 1 and found.errors["size"] is None
    surface = np.array(found.values["position"]) - found.values["size"] * np.array([1.0, 0, 0])
    np.testing.assert_allclose(surface, [1.05, 0, 3], atol=0.02)


def rolling(rng: np.random.Generator, clips: int) -> tuple[list[Track], dict[str, object]]:
    """Balls that roll straight on for 1 s at 60 Hz, with their measured spins."""
    radius, time, out = 0.05, np.arange(61) / 60, []
    for c in range(clips):
        angle, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 2.0)
        v = speed * np.array([np.cos(angle), np.sin(angle), 0.0])
        position = np.array([0, 0, radius]) + time[:, None] * v + rng.normal(0, NOISE, (61, 3))
        spin = np.array([-v[1], v[0], 0.0]) / radius
        out.append(Track(f"clip_{c}", "ball", time, position, angular_velocity=np.tile(spin, (61, 1))))
    return out, {**KNOWN, "fit": []}


def test_spins_weigh_as_noise_and_a_common_factor_say(rng: np.random.Generator) -> None:
    tracks, data = rolling(rng, 1)
    known = known_scene(data)
    problem = build_problem(tracks, known, 0.0, rng)
    (stack,) = problem.stacks
    model = known_model(known, problem.stacks)
    start = initial_states(problem)[0]
    two = np.stack([start, start])
    two[1, :, 6:9] = 1.1 * two[0, :, 6:9]  # a factor, and a smaller rest
    two[1, :, 6:9] += 0.02 * np.linalg.norm(two[0, :, 6:9]) * rng.normal(size=3)
    rows, _ = run(stack, model, np.tile(model.start, (2, 1)), two)
    ours = (rows[1] - rows[0])[0, stack.weight[0].size :]
    plain, _ = run(replace(stack, spin_rows=0 * stack.spin_rows), model, np.tile(model.start, (2, 1)), two)
    change = (plain[1] - plain[0])[0, stack.weight[0].size :]  # of measured spins of zero: no factor matters
    measured = (stack.spin_rows * stack.spin_weight)[0].ravel()
    covariance = np.eye(len(measured)) + SPIN_SCALE**2 * np.outer(measured, measured)
    assert ours @ ours == pytest.approx(change @ np.linalg.solve(covariance, change), rel=1e-6)
    assert ours @ ours < 0.9 * (change @ change)  # most of it is a common factor


def test_spins_with_a_wrong_factor_do_not_look_like_a_wrong_length_scale(rng: np.random.Generator) -> None:
    tracks, data = rolling(rng, 6)
    tracks = [replace(t, angular_velocity=1.03 * t.angular_velocity) for t in tracks]
    known = known_scene(data)
    problem = build_problem(tracks, known, 0.0, rng)
    plain = known_model(known, problem.stacks)
    models = (plain, with_effect(plain, effect_kinds()["length_scale"], known))
    none, scaled = (fit(problem.stacks, m, m.start, initial_states(problem), problem.chosen) for m in models)
    assert none.total(problem.chosen) - scaled.total(problem.chosen) < 12  # 1 of each clip, not 60


def test_balls_that_are_taken_to_roll_roll_whatever_velocity_is_fitted(rng: np.random.Generator) -> None:
    tracks, data = rolling(rng, 4)
    tracks = [replace(t, angular_velocity=None) for t in tracks]
    known = known_scene(data)
    problem = build_problem(tracks, known, 0.0, rng)
    (stack,), model = problem.stacks, known_model(known, problem.stacks)
    begin = initial_states(problem)[0]
    v = rng.normal(0, 0.3, (len(stack), 2))  # a poor first guess
    begin[:, 3:5], begin[:, 6], begin[:, 7] = v, -v[:, 1] / 0.05, v[:, 0] / 0.05
    found = fit([stack], model, model.start, [begin], problem.chosen)
    x, y, wx, wy = found.starts[0][:, [3, 4, 6, 7]].T
    assert np.hypot(x - 0.05 * wy, y + 0.05 * wx).max() < 1e-9
    assert found.total(problem.chosen) < problem.rows + 5 * np.sqrt(2 * problem.rows)


def test_a_gentle_touch_cuts_both_balls_and_what_follows_it_is_left_out(rng: np.random.Generator) -> None:
    radius, time = 0.05, np.arange(61) / 60
    objects = [{"name": n, "shape": "sphere", "radius": radius, "mass": 0.2} for n in ("ball", "other")]
    touch = float(rng.uniform(0.4, 0.5))
    x = np.where(time < touch, 0.06 * (time - touch), 0.03 * (time - touch)) - 2 * radius  # too gently to show
    positions = {"ball": x, "other": 0.03 * np.maximum(0, time - touch)}
    tracks = [
        Track(
            clip="c",
            object=name,
            time=time,
            position=np.stack([p, 0 * p, 0 * p + radius], 1) + rng.normal(0, 0.001, (61, 3)),
            angular_velocity=np.zeros((61, 3)),
        )
        for name, p in positions.items()
    ]
    cut = cut_tracks(tracks, known_scene({"objects": objects}))
    assert {(i.object, i.other) for i in cut.impacts} == {(0, 1), (1, 0)}
    assert not any(a.time[0] < touch < a.time[-1] for a in cut.arcs)


def test_a_ball_is_cut_where_it_touches_the_right_one_also_where_a_clip_does_not_show_them_all(
    rng: np.random.Generator,
) -> None:
    radii, time = {"ball": 0.05, "hidden": 0.3, "other": 0.05}, np.arange(61) / 60
    objects = [{"name": n, "shape": "sphere", "radius": r, "mass": 0.2} for n, r in radii.items()]
    x = {"ball": -0.3 + 0.2 * time, "other": 0.0 * time}  # 0.1 m apart in the end: they touch only then
    tracks = [
        Track(
            clip="c",
            object=n,
            time=time,
            position=np.stack([p, 0 * p, 0 * p + 0.05], 1) + rng.normal(0, 0.001, (61, 3)),
            angular_velocity=np.zeros((61, 3)),
        )
        for n, p in x.items()
    ]
    cut = cut_tracks(tracks, known_scene({"objects": objects}))
    assert {i.other for i in cut.impacts} <= {0, 2}
    assert max(a.time[-1] - a.time[0] for a in cut.arcs if a.object == 0) > 0.8


def test_an_effect_is_promising_where_a_fitted_number_at_its_bound_would_do_the_same(rng: np.random.Generator) -> None:
    known = known_scene({**KNOWN, "fit": ["rolling_friction"]})
    times, tracks = np.arange(61) / 60, []
    for c in range(4):
        spin = rng.uniform(90, 120) - 80 * times  # MuJoCo's own torsional friction takes 49 rad/s a second
        turn = np.column_stack([0 * times, 0 * times, spin]) + rng.normal(0, 0.1, (61, 3))
        place = np.array([0, 0, 0.05]) + rng.normal(0, 0.001, (61, 3))
        tracks.append(Track(f"clip_{c}", "ball", times, place, angular_velocity=turn))
    problem = build_problem(tracks, known, 0.3, rng)
    model = known_model(known, problem.stacks)
    found = fit(problem.stacks, model, model.start, initial_states(problem), problem.chosen)
    torsional = model.column("object:0", "torsional")
    assert torsional is not None and found.theta[torsional] == pytest.approx(model.unknowns[torsional].high, rel=1e-3)
    screening = ScreeningRegression(problem, found)
    kinds = [effect_kinds()[name] for name in ("spin_friction", "tilted_gravity")]
    promising, idle = (screening.guesses(k)[0].gain for k in kinds)
    assert promising > 100 > idle
