"""Verdicts that name effects and report what they leave, and lift by spins that were not measured."""

from dataclasses import replace

import numpy as np
import pytest
from small_world import KNOWN, NOISE, effect, thrown

from pipeline.discovery.discover import discover
from pipeline.discovery.fitting.calibration import calibrate
from pipeline.discovery.fitting.extension import extend
from pipeline.discovery.report.html_page import sentence
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.selection.forecast import forecast_error
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import build_problem, with_unmeasured_spins
from pipeline.discovery.tracks.track import Track
from pipeline.hidden.events import run_events
from pipeline.hidden.law_perturbation import LawPerturbation
from pipeline.scene.effects.kinds.magnus_lift import sphere_coefficient
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Scene, SceneObject

FEW = ("air_drag", "linear_drag", "tilted_gravity", "gravity_error", "magnus_lift")


def swirling(rng: np.random.Generator, clips: int = 8) -> list[Track]:
    """Throws with drag beside a force that is no effect."""
    out, times = [], np.arange(61) / 60
    law = LawPerturbation(
        extra=lambda t, x, v: 1.5 * np.stack([np.sin(4 * x[..., 1]), 0 * x[..., 0], 0 * x[..., 0]], -1)
    )
    for c in range(clips):
        velocity = (*rng.normal(0, 4, 2), rng.uniform(0, 2))
        ball = SceneObject(
            "sphere", (0.05,), 0.2, position=(*rng.normal(0, 0.3, 2), 9.0), velocity=velocity, name="ball"
        )
        scene = Scene((ball,), effects=(effect("air_drag", coefficient=0.02),))
        position = run_events(scene, times, law)[0][:, 0] + rng.normal(0, NOISE, (61, 3))
        out.append(Track(f"clip_{c}", "ball", times, position))
    return out


def test_drag_is_named_beside_an_unlisted_force_and_what_it_leaves_is_reported() -> None:
    rng = np.random.default_rng(3)
    found = discover(swirling(rng), known_scene(KNOWN), 0.3, FEW, rng)
    assert found.verdict.effects == ("air_drag",)
    left = found.verdict.remainder
    assert left is not None and left.regimes == ("flight",) and left.objects == ("ball",)
    assert found.gap.after < 0.5 * found.gap.before and found.gap.after > 1.3 * found.gap.noise_floor
    assert left.noise_floors == pytest.approx(found.gap.after / found.gap.noise_floor)
    report = report_dict(found)
    assert report["verdict"]["remainder"]["share"] == pytest.approx(found.gap.left)
    assert report["verdict"]["named"][0]["parameters"] == report["verdict"]["parameters"]
    assert "remains in flight" in sentence(report)


def test_drag_and_lift_are_named_where_spins_were_not_measured() -> None:
    rng = np.random.default_rng(4)
    hidden = effect("air_drag", coefficient=0.01), effect("magnus_lift", coefficient=0.001)
    found = discover(thrown(rng, 8, hidden, spin=False), known_scene(KNOWN), 0.3, FEW, rng)
    assert found.verdict.effects == ("air_drag", "magnus_lift")
    assert found.gap.after == pytest.approx(found.gap.noise_floor, rel=0.25)
    assert found.verdict.parameters["magnus_lift.coefficient"].stderr is None  # only its product with the spin is known
    assert any("spins were not measured" in note for note in found.notes)
    assert "magnus_lift" not in found.selection.untestable


def test_without_lift_the_spins_that_were_not_measured_are_nothing() -> None:
    rng = np.random.default_rng(5)
    problem = build_problem(thrown(rng, 6, spin=False), known_scene(KNOWN), 0.3, rng)
    calibration = calibrate(problem)
    (lifted,) = extend(calibration, calibration.none, [effect_kinds()["magnus_lift"]], lambda _: None)
    assert lifted.score > calibration.none.score  # the unknown spins cost more than they explain
    assert forecast_error(lifted) >= 0.95 * forecast_error(calibration.none)


def test_the_product_of_spin_and_coefficient_is_that_of_the_motion() -> None:
    rng = np.random.default_rng(6)
    tracks = thrown(rng, 6, (effect("magnus_lift", coefficient=0.001),))
    problem = build_problem([replace(t, angular_velocity=None) for t in tracks], known_scene(KNOWN), 0.3, rng)
    calibration = calibrate(problem)
    (lifted,) = extend(calibration, calibration.none, [effect_kinds()["magnus_lift"]], lambda _: None)
    for i, number in enumerate(problem.stacks[0].index):
        arc = problem.arcs[number]
        track = next(t for t in tracks if t.clip == arc.clip)
        velocity = np.gradient(arc.position, arc.time, axis=0).mean(0)
        assert track.angular_velocity is not None
        true, ours = (
            0.001 * track.angular_velocity[0],
            sphere_coefficient(0.05)["coefficient"] * lifted.fit.starts[0][i, 6:9],
        )
        assert np.cross(ours, velocity) == pytest.approx(np.cross(true, velocity), abs=0.01)  # N


def test_spins_that_were_measured_stay_as_they_were() -> None:
    rng = np.random.default_rng(7)
    problem = build_problem(thrown(rng, 4), known_scene(KNOWN), 0.3, rng)
    assert with_unmeasured_spins(problem) == problem
