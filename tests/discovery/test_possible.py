"""No effect is named whose number physics forbids, or that another recording would not show."""

import numpy as np
import pytest

from pipeline.api.discover import discover
from pipeline.discovery.fitting.calibration import Calibration, calibrate
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import extend
from pipeline.discovery.fitting.possible import _inside
from pipeline.discovery.selection.stability import is_stable
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import build_problem
from pipeline.discovery.tracks.track import Track
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.kind import Parameter
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject

MASSES = (0.0005, 0.001, 0.0015, 0.002)
SCENE = {
    "objects": [{"name": "cup", "shape": "cylinder", "radius": 0.04, "height": 0.03, "mass": MASSES[0]}],
    "clips": {f"drop_{i}": {"objects": {"cup": {"mass": m}}} for i, m in enumerate(MASSES)},
}
EQUAL = (0.0015,) * 4
NARROWER = (0.0015, 0.00143, 0.00125, 0.0012)  # kg/m: cups in cups are narrower


def drops(coefficients: tuple[float, ...], steady: bool = True, linear: float = 0.0) -> list[Track]:
    """Paper cups that fall with quadratic drag, one to four in one another: steadily, or from rest with linear drag."""
    rng, tracks = np.random.default_rng(5), []
    time = np.arange(60) / 60
    for i, (mass, k) in enumerate(zip(MASSES, coefficients, strict=True)):
        end = np.sqrt(mass * 9.81 / k)  # m/s
        height = 2 - end * time
        if not steady:
            cup = SceneObject("cylinder", (0.04, 0.03), mass, position=(0, 0, 2), name="cup")
            laws = (Effect("air_drag", (("coefficient", k),)), Effect("linear_drag", (("coefficient", linear),)))
            height = simulate(Scene((cup,), effects=laws), 1.0).position[:240:4, 0, 2]
        there = height > 0.3
        place = np.column_stack([0 * height, 0 * height, height + rng.normal(0, 0.002, len(time))])
        tracks.append(Track(f"drop_{i}", "cup", time[there], place[there]))
    return tracks


def test_a_steady_fall_is_neither_weightless_nor_on_another_clock() -> None:
    scales = "gravity_error,buoyancy,clock_rate,length_scale"
    assert discover(drops(EQUAL), known_scene(SCENE), effects=scales).verdict == ("unknown",)
    assert "air_drag" in discover(drops(EQUAL), known_scene(SCENE), effects=f"air_drag,{scales}").verdict


def with_both_drags(tracks: list[Track]) -> tuple[Calibration, Candidate]:
    calibration = calibrate(build_problem(tracks, known_scene(SCENE), 0.3, np.random.default_rng(0)))
    found = calibration.none
    for name in ("air_drag", "linear_drag"):
        (found,) = extend(calibration, found, [effect_kinds()[name]], lambda _: None)
    return calibration, found


def test_a_second_drag_that_each_recording_wants_otherwise_is_not_stable() -> None:
    assert not is_stable(*with_both_drags(drops(NARROWER)))


def test_two_drags_that_act_in_all_recordings_are_stable() -> None:
    assert is_stable(*with_both_drags(drops((0.0008,) * 4, steady=False, linear=0.001)))


@pytest.mark.parametrize(
    ("name", "value", "possible"),
    [
        ("air_drag", 0.0, True),  # no effect
        ("clock_rate", 5.0, False),
        ("clock_rate", 1.0, True),
        ("buoyancy", 1.01, False),
        ("buoyancy", 0.2, True),
        ("gravity_error", 0.0, False),
        ("gravity_error", 9.81, True),
        ("hidden_obstacle", 0.005, False),
        ("anisotropic_friction", 50.0, False),
        ("tilted_gravity", 0.1, True),
    ],
)
def test_a_number_at_the_end_of_its_range_is_not_possible(name: str, value: float, possible: bool) -> None:
    parameter = next(p for p in effect_kinds()[name].parameters if p.length == 1 or name == "tilted_gravity")
    assert _inside(parameter, np.full(parameter.length, value)) == possible


def test_a_direction_has_no_end() -> None:
    assert _inside(Parameter("angle", "rad", low=-1.6, high=1.6, period=np.pi), np.array([1.6]))


@pytest.mark.parametrize("kind", effect_kinds().values(), ids=lambda k: k.name)
def test_what_is_possible_is_allowed_and_has_no_effect_in_it(kind) -> None:  # type: ignore[no-untyped-def]
    for p in kind.parameters:
        low, high = p.possible
        assert p.low <= low <= p.neutral <= high <= p.high
