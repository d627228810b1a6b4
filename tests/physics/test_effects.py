"""Laws that the effects obey, alone, in a simulation and in a batch."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from pipeline.physics.simulate import compile_xml, simulate
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Effect, Scene, SceneObject

BALL = SceneObject(
    "sphere", (0.1,), 0.5, position=(0, 0, 2), velocity=(2, 0.5, 1), angular_velocity=(3, -20, 5), name="ball"
)
PUCK = SceneObject("cylinder", (0.1, 0.04), 0.5, 0.3, position=(0, 0, 0.02), velocity=(1.5, 0.5, 0), name="puck")


def effect(name: str, **values: Any) -> Effect:
    return Effect(name, tuple(values.items()))


def end(scene: Scene, seconds: float = 0.5) -> np.ndarray:
    return simulate(scene, seconds).position[-1, 0]


def test_the_names_are_those_of_the_format() -> None:
    named = [
        "air_drag",
        "linear_drag",
        "wind",
        "magnus_lift",
        "buoyancy",
        "gravity_error",
        "tilted_gravity",
        "rolling_resistance",
        "spin_friction",
        "viscous_friction",
        "friction_error",
        "anisotropic_friction",
        "restitution",
        "off_center_mass",
        "hidden_obstacle",
        "hidden_attractor",
        "pair_attraction",
        "moving_ground",
        "rotating_frame",
        "impulse",
        "adhesion",
        "clock_rate",
        "length_scale",
    ]
    assert set(named) == set(effect_kinds())


@pytest.mark.parametrize("kind", effect_kinds().values(), ids=lambda k: k.name)
def test_every_effect_has_units_bounds_and_something_that_it_does(kind: EffectKind) -> None:
    assert kind.force or kind.torque or kind.edit or kind.recording
    assert kind.experiment and kind.formula and kind.regimes
    assert kind.bounce_ratio is None or [p.length for p in kind.parameters] == [1]
    for p in kind.parameters:
        assert p.low <= p.neutral <= p.high and p.scale > 0 and p.unit


def test_linear_drag_slows_a_body_exponentially() -> None:
    scene = Scene((BALL,), gravity=(0, 0, 0), ground=None, effects=(effect("linear_drag", coefficient=0.4),))
    trace = simulate(scene, 1.0)
    expected = np.array(BALL.velocity) * np.exp(-0.4 / 0.5 * 1.0)
    np.testing.assert_allclose(trace.velocity[-1, 0], expected, rtol=2e-3)


def test_quadratic_drag_slows_a_body_as_one_over_time() -> None:
    ball = replace(BALL, velocity=(4.0, 0, 0))
    trace = simulate(
        Scene((ball,), gravity=(0, 0, 0), ground=None, effects=(effect("air_drag", coefficient=0.1),)), 1.0
    )
    assert trace.velocity[-1, 0, 0] == pytest.approx(4 / (1 + 0.1 / 0.5 * 4), rel=3e-3)


def test_in_a_wind_a_body_ends_up_with_it() -> None:
    wind = effect("wind", velocity=(3.0, 0.0, 0.0), coefficient=2.0)
    trace = simulate(Scene((BALL,), gravity=(0, 0, 0), ground=None, effects=(wind,)), 8.0)
    np.testing.assert_allclose(trace.velocity[-1, 0], [3, 0, 0], atol=0.1)


def test_lift_turns_the_velocity_and_keeps_the_speed() -> None:
    ball = replace(BALL, velocity=(2, 0, 0), angular_velocity=(0, 0, 20))
    trace = simulate(
        Scene((ball,), gravity=(0, 0, 0), ground=None, effects=(effect("magnus_lift", coefficient=0.02),)), 1.0
    )
    angle = 0.02 * 20 / 0.5 * 1.0
    np.testing.assert_allclose(trace.velocity[-1, 0], [2 * np.cos(angle), 2 * np.sin(angle), 0], atol=0.01)


def test_full_buoyancy_and_no_gravity_are_the_same() -> None:
    float_, none = (
        Scene((BALL,), ground=None, effects=(e,))
        for e in (effect("buoyancy", fraction=1.0), effect("gravity_error", gravity=0.0))
    )
    np.testing.assert_allclose(end(float_), end(none), atol=1e-9)
    np.testing.assert_allclose(end(none), np.array(BALL.position) + 0.5 * np.array(BALL.velocity), atol=1e-9)


def test_tilted_gravity_makes_a_body_slide_off() -> None:
    scene = Scene((replace(PUCK, velocity=(0, 0, 0)),), effects=(effect("tilted_gravity", tilt=(0.0, -0.5)),))
    expected = (9.81 * np.sin(0.5) - 0.3 * 9.81 * np.cos(0.5)) / 2 * 0.5**2
    assert end(scene)[0] == pytest.approx(expected, rel=0.05)


def test_in_a_rotating_frame_a_free_body_goes_straight_in_the_resting_one() -> None:
    rate, seconds = 0.7, 1.0
    start = np.array([1.0, 0, 2])
    ball = replace(BALL, position=tuple(start), velocity=(0.5, -rate * 1.0, 0))  # at rest: v = W x r taken off
    scene = Scene((ball,), gravity=(0, 0, 0), ground=None, effects=(effect("rotating_frame", angular_velocity=rate),))
    x, y, _ = simulate(scene, seconds).position[-1, 0]
    c, s = np.cos(rate * seconds), np.sin(rate * seconds)
    np.testing.assert_allclose([c * x - s * y, s * x + c * y], [1.5, 0.0], atol=3e-3)


def test_an_impulse_changes_the_velocity_by_momentum_over_mass() -> None:
    blow = effect("impulse", time=0.25, momentum=(0.5, 0.0, -0.25))
    trace = simulate(Scene((BALL,), gravity=(0, 0, 0), ground=None, effects=(blow,)), 0.5)
    np.testing.assert_allclose(trace.velocity[-1, 0] - BALL.velocity, [1, 0, -0.5], atol=1e-6)
    np.testing.assert_allclose(trace.velocity[58, 0], BALL.velocity, atol=1e-9)


def test_two_bodies_attract_with_opposite_forces() -> None:
    pair = (replace(BALL, velocity=(0, 0, 0)), replace(BALL, name="other", position=(1, 0, 2), velocity=(0, 0, 0)))
    trace = simulate(
        Scene(pair, gravity=(0, 0, 0), ground=None, effects=(effect("pair_attraction", strength=0.1),)), 0.2
    )
    assert trace.velocity[-1, 0, 0] == pytest.approx(0.2 * 0.1 / 0.5, rel=0.02)
    np.testing.assert_allclose(trace.velocity[-1, 0], -trace.velocity[-1, 1], atol=1e-9)


def test_an_attractor_pulls_towards_its_place_and_only_the_objects_named() -> None:
    law = Effect("hidden_attractor", (("position", (0.0, 1.0, 2.0)), ("strength", 0.2)), ("ball",))
    pair = (replace(BALL, velocity=(0, 0, 0)), replace(BALL, name="other", position=(3, 0, 2), velocity=(0, 0, 0)))
    trace = simulate(Scene(pair, gravity=(0, 0, 0), ground=None, effects=(law,)), 0.1)
    np.testing.assert_allclose(trace.velocity[-1, 0], [0, 0.1 * 0.2 / 0.5, 0], atol=1e-3)
    np.testing.assert_allclose(trace.velocity[-1, 1], 0, atol=1e-12)


def test_a_belt_carries_a_resting_puck_along() -> None:
    scene = Scene((replace(PUCK, velocity=(0, 0, 0)),), effects=(effect("moving_ground", velocity=(0.4, 0.0)),))
    trace = simulate(scene, 1.0)
    assert trace.velocity[-1, 0, 0] == pytest.approx(0.4, abs=0.02)


def test_viscous_friction_acts_in_contact_alone() -> None:
    law = (effect("viscous_friction", coefficient=1.0),)
    np.testing.assert_allclose(end(Scene((BALL,), effects=law)), end(Scene((BALL,))))
    slick = replace(PUCK, sliding_friction=0.0)
    trace = simulate(Scene((slick,), effects=law), 0.5)
    assert trace.velocity[-1, 0, 0] == pytest.approx(1.5 * np.exp(-0.5 / 0.5), rel=0.06)


def test_viscous_friction_acts_against_the_velocity_relative_to_a_belt() -> None:
    slick = replace(PUCK, sliding_friction=0.0, velocity=(0, 0, 0))
    law = (effect("viscous_friction", coefficient=1.0), effect("moving_ground", velocity=(0.4, 0.0)))
    trace = simulate(Scene((slick,), effects=law), 0.5)
    assert trace.velocity[-1, 0, 0] == pytest.approx(0.4 * (1 - np.exp(-0.5 / 0.5)), rel=0.06)


def test_anisotropic_friction_stops_a_puck_sooner_along_the_rough_direction() -> None:
    law = (effect("anisotropic_friction", ratio=0.3, angle=0.0),)
    along, across = (end(Scene((replace(PUCK, velocity=v),), effects=law), 1.0) for v in ((1.5, 0, 0), (0, 1.5, 0)))
    assert along[0] == pytest.approx(1.5**2 / 2 / (0.3 * 9.81), rel=0.05)
    assert across[1] == pytest.approx(1.5 - 0.3 * 0.3 * 9.81 / 2, rel=0.06)


def test_adhesion_presses_a_puck_on_the_ground() -> None:
    ball = SceneObject("sphere", (0.1,), 0.5, 0.3, position=(0, 0, 0.1), velocity=(2, 0, 0))
    loss = [
        2 - simulate(Scene((ball,), effects=e), 0.08).velocity[-1, 0, 0] for e in ((), (effect("adhesion", force=5.0),))
    ]
    assert 1.25 < loss[1] / loss[0] < 1.1 + 5 / 0.5 / 9.81  # MuJoCo's adhesion pauses where the contact does


def test_rolling_resistance_slows_a_rolling_ball() -> None:
    ball = SceneObject("sphere", (0.1,), 0.5, position=(0, 0, 0.1), velocity=(1, 0, 0), angular_velocity=(0, 10, 0))
    trace = simulate(Scene((ball,), effects=(effect("rolling_resistance", coefficient=0.005),)), 0.5)
    assert trace.velocity[-1, 0, 0] == pytest.approx(1 - 0.5 * 5 / 7 * 0.005 * 9.81 / 0.1, rel=0.03)


def test_spin_friction_slows_a_spinning_ball() -> None:
    ball = SceneObject("sphere", (0.1,), 0.5, position=(0, 0, 0.1), angular_velocity=(0, 0, 30))
    plain, slowed = (
        simulate(Scene((ball,), effects=e), 0.3).angular_velocity[-1, 0, 2]
        for e in ((), (effect("spin_friction", coefficient=0.005),))
    )
    assert slowed - plain == pytest.approx(-0.3 * 0.005 * 9.81 / (0.4 * 0.1**2), rel=0.1)


def test_a_hidden_obstacle_turns_a_body_back() -> None:
    wall = effect("hidden_obstacle", position=(1.0, 0.0, 2.0), size=0.3)
    ball = replace(BALL, velocity=(4, 0, 0))
    assert simulate(Scene((ball,), gravity=(0, 0, 0), ground=None, effects=(wall,)), 0.5).position[..., 0].max() < 0.75


def test_an_off_center_body_turns_about_its_centre_of_mass() -> None:
    box = SceneObject("box", (0.1, 0.1, 0.1), 0.4, position=(0, 0, 2), velocity=(0, 0, 0), angular_velocity=(0, 0, 10))
    trace = simulate(
        Scene((box,), gravity=(0, 0, 0), ground=None, effects=(effect("off_center_mass", offset=(0.02, 0, 0)),))
    )
    from pipeline.scene.rotation import rotate

    centre = trace.position[:, 0] + rotate(trace.quaternion[:, 0], np.array([0.02, 0, 0]))
    straight = np.linspace(centre[0], centre[-1], len(centre))
    np.testing.assert_allclose(centre, straight, atol=2e-3)
    assert (
        np.abs(trace.position[:, 0] - np.linspace(trace.position[0, 0], trace.position[-1, 0], len(centre))).max()
        > 0.01
    )


EXAMPLES = {
    "air_drag": {"coefficient": 0.02},
    "linear_drag": {"coefficient": 0.1},
    "magnus_lift": {"coefficient": 0.002},
    "wind": {"velocity": (1.0, 2.0, 0.0), "coefficient": 0.02},
    "buoyancy": {"fraction": 0.2},
    "gravity_error": {"gravity": 8.0},
    "tilted_gravity": {"tilt": (0.1, 0.05)},
    "rolling_resistance": {"coefficient": 0.003},
    "spin_friction": {"coefficient": 0.01},
    "viscous_friction": {"coefficient": 0.3},
    "anisotropic_friction": {"ratio": 0.5, "angle": 0.4},
    "friction_error": {"coefficient": 0.3},
    "restitution": {"coefficient": 0.8},
    "off_center_mass": {"offset": (0.01, 0.0, 0.02)},
    "hidden_obstacle": {"position": (0.6, 0.2, 2.3), "size": 0.2},
    "hidden_attractor": {"position": (1.0, 1.0, 1.0), "strength": 0.3},
    "pair_attraction": {"strength": 0.05},
    "moving_ground": {"velocity": (0.3, 0.1)},
    "rotating_frame": {"angular_velocity": 0.4},
    "impulse": {"time": 0.2, "momentum": (0.1, 0.0, 0.2)},
    "adhesion": {"force": 2.0},
    "clock_rate": {"ratio": 1.1},
    "length_scale": {"ratio": 0.9},
}


def test_there_is_an_example_of_every_effect() -> None:
    assert set(EXAMPLES) == set(effect_kinds())


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_the_mjcf_of_every_effect_loads_and_says_what_it_lacks(name: str) -> None:
    xml = scene_xml(Scene((BALL, PUCK), effects=(effect(name, **EXAMPLES[name]),)))
    model = compile_xml(xml)
    assert isinstance(model, mujoco.MjModel)
    kind = effect_kinds()[name]
    assert ("effect_0" in xml) == (kind.edit is None and kind.fluid is None)
