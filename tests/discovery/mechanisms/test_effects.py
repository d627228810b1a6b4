"""The laws of the effects of mechanisms, as MuJoCo has them."""

import mujoco
import numpy as np
import pytest

from pipeline.discovery.mechanisms.held_control import held, lagged
from pipeline.discovery.mechanisms.registry import mechanism_effects

MODEL = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -10"/>
  <worldbody>
    <body name="arm" pos="0 0 1">
      <joint name="j" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="j"/></actuator>
</mujoco>
"""
#: docs/formats.md: name -> parameters.
PARAMETERS = {
    "actuator_delay": ["delay"],
    "actuator_gain": ["ratio"],
    "actuator_lag": ["time_constant"],
    "actuator_limit": ["limit"],
    "actuator_offset": ["offset"],
    "armature": ["inertia"],
    "clock_rate": ["ratio"],
    "gravity_error": ["gravity"],
    "joint_damping": ["coefficient"],
    "joint_friction": ["f"],
    "joint_limit": ["position", "side"],
    "joint_spring": ["stiffness", "rest"],
    "joint_stiction": ["f", "speed"],
    "load_friction": ["share"],
    "payload": ["mass", "position"],
    "quadratic_damping": ["coefficient"],
    "sensor_delay": ["value"],
    "sensor_offset": ["value"],
    "sensor_scale": ["value"],
    "tilted_gravity": ["tilt"],
}


def with_effect(name: str, place: str, **values: object) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(MODEL)
    edit = mechanism_effects()[name].edit
    assert edit is not None
    edit(spec, place, {k: np.atleast_1d(np.array(v, float)) for k, v in values.items()})
    return spec.compile()


def acceleration(model: mujoco.MjModel, q: float = 0.0, v: float = 0.0, u: float = 0.0) -> float:
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0], data.ctrl[0] = q, v, u
    mujoco.mj_forward(model, data)
    return float(data.qacc[0])


def test_the_effects_have_the_parameters_of_the_formats() -> None:
    assert {k: [p.name for p in e.parameters] for k, e in mechanism_effects().items()} == PARAMETERS
    assert all(e.name == name and e.formula and e.experiment for name, e in mechanism_effects().items())


@pytest.mark.parametrize(
    ("name", "place", "values", "torque"),
    [
        ("joint_damping", "j", {"coefficient": 0.3}, -0.3 * -2),
        ("quadratic_damping", "j", {"coefficient": 0.3}, 0.3 * 4),
        ("joint_spring", "j", {"stiffness": 2.0, "rest": 0.7}, -2.0 * (0.4 - 0.7)),
        ("actuator_gain", "m", {"ratio": 1.5}, 0.5 * 0.6),
        ("actuator_offset", "m", {"offset": 0.2}, 0.2),
        ("actuator_limit", "m", {"limit": 0.5}, -0.1),
    ],
)
def test_laws_that_are_torques(name: str, place: str, values: dict[str, float], torque: float) -> None:
    model, plain = with_effect(name, place, **values), mujoco.MjModel.from_xml_string(MODEL)
    state = {"q": 0.4, "v": -2.0, "u": 0.6}
    inertia = float(plain.dof_M0[0])
    assert (acceleration(model, **state) - acceleration(plain, **state)) * inertia == pytest.approx(torque, abs=1e-6)


def test_armature_and_a_payload_add_inertia() -> None:
    plain = mujoco.MjModel.from_xml_string(MODEL)
    assert with_effect("armature", "j", inertia=0.2).dof_M0[0] == pytest.approx(plain.dof_M0[0] + 0.2)
    loaded = with_effect("payload", "arm", mass=0.5, position=[0.8, 0.0, 0.1])
    assert loaded.dof_M0[0] == pytest.approx(plain.dof_M0[0] + 0.5 * (0.8**2 + 0.1**2))
    assert loaded.body("arm").mass[0] == pytest.approx(1.5)
    # The weight of rod and load, level, about the hinge.
    weight = 10 * (1 * 0.5 + 0.5 * 0.8)
    assert acceleration(loaded) * loaded.dof_M0[0] == pytest.approx(weight, rel=1e-9)


def test_dry_friction_holds_at_rest() -> None:
    def after(f: float) -> float:
        model = with_effect("joint_friction", "j", f=f)
        data = mujoco.MjData(model)
        for _ in range(300):
            mujoco.mj_step(model, data)
        return float(data.qpos[0])

    assert after(6.0) < 0.03 < 0.2 < after(2.0)  # the weight makes 5 N m; MuJoCo's friction creeps a little


def test_a_stop_keeps_the_joint_on_its_side() -> None:
    model = with_effect("joint_limit", "j", position=0.3, side=1.0)
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert data.qpos[0] == pytest.approx(0.3, abs=0.02)


def test_gravity_is_scaled_and_turned() -> None:
    assert with_effect("gravity_error", "", gravity=9.0).opt.gravity.tolist() == [0, 0, -9]
    assert np.linalg.norm(with_effect("tilted_gravity", "", tilt=[0.1, 0.2]).opt.gravity) == pytest.approx(10)


@pytest.mark.parametrize(
    ("name", "values"), [("actuator_lag", {"time_constant": 0.05}), ("actuator_delay", {"delay": 0.03})]
)
def test_controls_that_we_change_are_those_of_mujocos_own_elements(name: str, values: dict[str, float]) -> None:
    time = np.arange(0, 1, 0.01)
    control = np.repeat(np.random.default_rng(0).normal(0, 1, 20), 5)
    control[:5] = 0.0
    kind = mechanism_effects()[name]
    assert kind.controls is not None
    at = np.arange(1001) * 0.001
    changed = kind.controls({k: np.array([v]) for k, v in values.items()}, time, control, at)
    paths = []
    for model, u in (
        (with_effect(name, "m", **values), np.repeat(control, 10)),
        (mujoco.MjModel.from_xml_string(MODEL), changed),
    ):
        data = mujoco.MjData(model)
        for x in u:
            data.ctrl[0] = x
            mujoco.mj_step(model, data)
        paths.append(float(data.qpos[0]))
    assert paths[0] == pytest.approx(paths[1], rel=2e-3)


def test_a_held_control_is_the_mean_over_each_step() -> None:
    time, control = np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0])
    assert held(time, control, np.array([-1.0, 0.0, 0.5, 1.5, 4.0])).tolist() == pytest.approx(
        [1, 1, 2, (1.5 + 10) / 2.5]
    )
    assert lagged(time, control, np.array([9.0, 9.1]), 0.1)[0] == pytest.approx(5)


def test_friction_laws() -> None:
    stiction, load = (mechanism_effects()[n].friction for n in ("joint_stiction", "load_friction"))
    assert stiction is not None and load is not None
    values = {"f": np.array([2.0]), "speed": np.array([0.5])}
    assert stiction(values, 0.0, 0.0) == 2.0 and stiction(values, 0.5, 0.0) == pytest.approx(2 / np.e)
    assert load({"share": np.array([0.1])}, 1.0, -3.0) == pytest.approx(0.3)
