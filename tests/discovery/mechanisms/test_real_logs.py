"""Schmidt and Lipson's pendulum and carts, where they are there (DYNAMICS_DATA, else ../shared/data).

The models are what is known of them: the pendulum's length and the carts' springs from their frequencies; no friction.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_mechanism import discovered

from benchmarks.published.published_set import real_motion_folder

FRICTION = {"joint_damping", "joint_friction", "joint_stiction", "quadratic_damping"}
PENDULUM = """
<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="bob">
<joint name="hinge" axis="0 1 0"/><inertial pos="0 0 -7.22" mass="1" diaginertia="1e-6 1e-6 1e-6"/>
</body></worldbody></mujoco>
"""
CART = """
<mujoco><option timestep="0.005" integrator="RK4" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="cart" type="slide" axis="1 0 0" stiffness="6.22"/><geom type="box" size=".05 .05 .05" mass="1"/>
</body></worldbody></mujoco>
"""
TWO_CARTS = """
<mujoco><option timestep="0.005" integrator="RK4" gravity="0 0 0"><flag contact="disable"/></option><worldbody>
<body name="left"><joint name="left" type="slide" axis="1 0 0" stiffness="7.78" springref="0.063"/>
<geom type="box" size=".05 .05 .05" mass="1"/></body>
<body name="right"><joint name="right" type="slide" axis="1 0 0" stiffness="7.70" springref="-0.062"/>
<geom type="box" size=".05 .05 .05" mass="2.47"/></body></worldbody>
<tendon><fixed name="spring" stiffness="77.93" springlength="0.125"><joint joint="left" coef="1"/>
<joint joint="right" coef="-1"/></fixed></tendon></mujoco>
"""


@pytest.fixture
def folder() -> Path:
    found = real_motion_folder()
    if found is None or not (found.parent / "mechanisms").is_dir():
        pytest.skip("no published logs here: set DYNAMICS_DATA to the folder that has mechanisms")
    return found.parent / "mechanisms"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "columns", "unit", "model"),
    [
        ("real_pend_h_1", ["hinge"], 1.0, PENDULUM),
        ("real_linear_h_1", ["cart"], 1e-3, CART),
        ("real_double_linear_h_1", ["left", "right"], 1e-3, TWO_CARTS),
    ],
)
def test_friction_is_named_and_the_second_half_forecast(
    folder: Path, tmp_path: Path, name: str, columns: list[str], unit: float, model: str
) -> None:
    lines = [line for line in (folder / f"{name}.txt").read_text().splitlines() if not line.startswith("%")]
    rows = np.array([[float(word) for word in line.split()] for line in lines])
    log = pd.DataFrame({"time": rows[:, 1]} | {c: unit * rows[:, 2 + k] for k, c in enumerate(columns)})
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "model.xml").write_text(model)
    found = discovered(tmp_path / "log.csv", tmp_path / "model.xml", held_out=0.5)
    assert set(found.verdict.effects) & FRICTION
    assert found.gap.after <= 0.3 * found.gap.before
