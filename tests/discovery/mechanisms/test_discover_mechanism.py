"""What a model of a mechanism lacks is named from its log, and nothing where nothing is hidden."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_mechanism import CART, GRAVITY, LENGTH, MASS, PENDULUM, Acceleration, discovered, path_of, write_log

INERTIA = MASS * LENGTH**2


def weight(q: float) -> float:
    return -GRAVITY / LENGTH * float(np.sin(q))


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM)
    return path


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    path = tmp_path / "cart.xml"
    path.write_text(CART)
    return path


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "law"),
    [
        ("joint_damping", "coefficient", 0.02, lambda q, v, u: weight(q) - 0.02 / INERTIA * v),
        ("joint_friction", "f", 0.02, lambda q, v, u: weight(q) - 0.02 / INERTIA * float(np.tanh(v / 1e-3))),
        ("quadratic_damping", "coefficient", 0.02, lambda q, v, u: weight(q) - 0.02 / INERTIA * abs(v) * v),
    ],
)
def test_the_friction_of_a_pendulum_is_named(
    pendulum: Path, effect: str, parameter: str, value: float, law: Acceleration
) -> None:
    log = pendulum.with_name("log.csv")
    write_log(log, "hinge", law, 2e-3, np.random.default_rng(1))
    found = discovered(log, pendulum)
    assert found.verdict.effects == (effect,)
    estimate = found.verdict.parameters[parameter]
    assert found.verdict.parameters["joint"].value == "hinge"
    assert estimate.value == pytest.approx(value, rel=0.05)
    assert found.gap.after < 0.2 * found.gap.before and found.gap.after < 1.3 * found.gap.noise_floor


def test_nothing_is_named_where_nothing_is_hidden(pendulum: Path) -> None:
    log = pendulum.with_name("log.csv")
    write_log(log, "hinge", lambda q, v, u: weight(q), 2e-3, np.random.default_rng(2))
    found = discovered(log, pendulum)
    assert found.verdict.effects == () and found.disagreement == ()
    assert found.gap.before == pytest.approx(found.gap.noise_floor, rel=0.2)


def test_time_steps_that_the_model_states_are_not_taken_for_physics(pendulum: Path) -> None:
    """Steps of 20 ms, by Euler's method, leave ten times the noise of this log."""
    pendulum.write_text(PENDULUM.replace('timestep="0.005" integrator="RK4"', 'timestep="0.02"'))
    log = pendulum.with_name("log.csv")
    write_log(log, "hinge", lambda q, v, u: weight(q) - 0.02 / INERTIA * v, 1e-3, np.random.default_rng(3))
    found = discovered(log, pendulum)
    assert found.verdict.effects == ("joint_damping",) and not found.selection.stated_steps
    assert found.gap.after < 1.3 * found.gap.noise_floor


def test_a_delay_that_is_shorter_than_the_time_between_two_samples_is_found(cart: Path) -> None:
    rng, time, parts = np.random.default_rng(4), np.arange(4000) / 1000, []
    for clip in range(4):
        control = np.repeat(rng.normal(0, 2.0, 10), 400)
        late = np.concatenate([np.full(6, control[0]), control[:-6]])
        q = path_of(lambda q, v, u: u - 20 * q, (rng.normal(0, 0.2), 0.0), time, late)[::20]
        q += rng.normal(0, 2e-4, len(q))
        parts.append(pd.DataFrame({"clip": f"clip_{clip}", "time": time[::20], "slide": q, "push": control[::20]}))
    log = cart.with_name("log.csv")
    pd.concat(parts).to_csv(log, index=False)
    found = discovered(log, cart)
    named = {*found.verdict.effects, *(name for alike in found.verdict.equivalent for name in alike)}
    assert "actuator_delay" in named  # a delay of the sensor may look the same


def test_the_gain_of_an_actuator_is_told_from_inertia(cart: Path) -> None:
    log = cart.with_name("log.csv")
    write_log(log, "slide", lambda q, v, u: -20 * q + 1.2 * u, 5e-4, np.random.default_rng(3), actuator="push")
    found = discovered(log, cart)
    (alike,) = found.verdict.equivalent  # a spring is linear: its sensor may as well show all of it larger
    assert set(alike) == {"actuator_gain", "sensor_scale"} and found.verdict.effects[0] in alike
    (gain,) = [c for c in found.selection.singles if c.effects == ("actuator_gain",)]
    assert gain.fit.theta[0] == pytest.approx(1.2, abs=0.01)
    assert gain.fit.model.acting[0].place.name == "push"


def test_two_frictions_of_a_cart_are_both_named(cart: Path) -> None:
    def law(q: float, v: float, u: float) -> float:
        return -20 * q + u - 0.4 * v - 0.3 * float(np.tanh(v / 1e-3))

    log = cart.with_name("log.csv")
    write_log(log, "slide", law, 2e-4, np.random.default_rng(4), actuator="push")
    found = discovered(log, cart)
    assert set(found.verdict.effects) == {"joint_damping", "joint_friction"}
    assert found.verdict.parameters["joint_damping.coefficient"].value == pytest.approx(0.4, rel=0.1)
    assert found.verdict.parameters["joint_friction.f"].value == pytest.approx(0.3, rel=0.1)


def test_a_number_that_is_not_known_is_calibrated_and_nothing_named(cart: Path) -> None:
    log = cart.with_name("log.csv")
    write_log(log, "slide", lambda q, v, u: -24 * q + u, 5e-4, np.random.default_rng(5), actuator="push")
    found = discovered(log, cart, fit=("slide.stiffness",))
    assert found.verdict.effects == ()
    assert found.calibrated["slide.stiffness"].value == pytest.approx(24, rel=0.01)
    assert found.calibrated["slide.stiffness"].unit == "N/m"


def test_the_end_of_a_single_clip_is_forecast(pendulum: Path) -> None:
    log = pendulum.with_name("log.csv")
    rng = np.random.default_rng(6)
    write_log(log, "hinge", lambda q, v, u: weight(q) - 0.2 * v, 2e-3, rng, clips=1)
    found = discovered(log, pendulum, held_out=0.5)
    assert found.verdict.effects == ("joint_damping",)
    assert found.gap.after < 0.1 * found.gap.before
    assert any("forecast" in note for note in found.notes)
