"""`dynamics discover LOG MODEL.xml`: files that plain MuJoCo loads, and one line for bad input."""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from small_mechanism import CART, GRAVITY, LENGTH, PENDULUM, write_log

from pipeline.api.discover import discover
from pipeline.api.discover_log import LogDiscoveryResult
from pipeline.commands.main import main
from pipeline.discovery.mechanisms.augmented import augmented_forces
from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.law_model import LawModel, with_effect
from pipeline.discovery.mechanisms.least_squares import Fit
from pipeline.discovery.mechanisms.log import read_log
from pipeline.discovery.mechanisms.mechanism import read_mechanism
from pipeline.discovery.mechanisms.noise import channel_noise
from pipeline.discovery.mechanisms.places import places_of
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.discovery.mechanisms.simulation import Simulator, States, Window, with_sensors


@pytest.fixture(scope="module")
def damped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log and the model of a damped pendulum."""
    folder = tmp_path_factory.mktemp("damped")
    (folder / "pendulum.xml").write_text(PENDULUM)
    rng = np.random.default_rng(1)
    write_log(
        folder / "log.csv", "hinge", lambda q, v, u: -GRAVITY / LENGTH * float(np.sin(q)) - 0.2 * v, 2e-3, rng, clips=3
    )
    return folder


def test_the_report_and_the_model_hold_what_was_named(damped: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["discover", str(damped / "log.csv"), str(damped / "pendulum.xml"), "-o", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"]["effects"] == ["joint_damping"]
    assert report["gap"]["metric"] == "joint_rmse" and report["gap"]["unit"] == "rad"
    assert report["gap"]["after"] < 0.3 * report["gap"]["before"]
    assert {d["object"] for d in report["disagreement"]} == {"hinge"}
    (named,) = report["verdict"]["named"]
    assert named["parameters"]["joint"]["value"] == "hinge"
    assert named["parameters"]["coefficient"]["unit"] == "N m s/rad"
    assert sum(c["probability"] for c in report["candidates"]) <= 1.0
    model = mujoco.MjModel.from_xml_path(str(out / "augmented.xml"))
    assert model.dof_damping[0] == pytest.approx(named["parameters"]["coefficient"]["value"], rel=1e-3)
    assert not (out / "augmented_forces.py").exists()  # MJCF says damping
    assert "joint_damping" in (out / "report.html").read_text()
    rows = pd.read_parquet(out / "residuals.parquet")
    assert len(rows) == 600 and rows["held_out"].sum() == 200
    assert {"recording.rrd", "result.json"} <= {p.name for p in out.iterdir()}


def test_from_python_the_model_takes_the_place_of_the_scene(damped: Path) -> None:
    found = discover(damped / "log.csv", damped / "pendulum.xml", effects="joint_damping,armature")
    assert isinstance(found, LogDiscoveryResult)
    assert found.verdict == ("joint_damping",) and found.sentence.startswith("The simulation lacks joint_damping")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["log.csv", "none.xml"], "no such file"),
        (["wrong.csv", "pendulum.xml"], "did you mean 'hinge'"),
        (["log.csv", "pendulum.xml", "--fit", "hing.damping"], "did you mean 'hinge'"),
        (["log.csv", "pendulum.xml", "--effects", "joint_dampin"], "did you mean 'joint_damping'"),
        (["log.csv", "pendulum.xml", "--held-out", "1"], "held_out"),
        (["log.csv", "pendulum.xml", "--unit", "cm"], "are for a table of positions"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    damped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    pd.read_csv(damped / "log.csv").rename(columns={"hinge": "hnge"}).to_csv(damped / "wrong.csv", index=False)
    inputs = [str(damped / w) if w.endswith((".csv", ".xml")) else w for w in words]
    assert main(["discover", *inputs, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert says in said[-1] and said[-1].startswith("error: ") and not (tmp_path / "out").exists()


def test_friction_that_mjcf_cannot_say_is_a_program_of_mujoco_and_numpy_alone(tmp_path: Path) -> None:
    """It makes the same motion as our own simulation."""
    (tmp_path / "cart.xml").write_text(CART)
    write_log(tmp_path / "log.csv", "slide", lambda q, v, u: -20 * q, 1e-3, np.random.default_rng(0))
    mechanism = read_mechanism(tmp_path / "cart.xml")
    log = read_log(tmp_path / "log.csv", mechanism)
    kind, places = mechanism_effects()["joint_stiction"], places_of(mechanism, log)
    model = with_effect(LawModel(()), kind, [p for p in places[kind.target] if p.name == "slide"])
    simulator = Simulator(mechanism, log, with_sensors(mechanism.physics, log.channels))
    problem = Problem(mechanism, log, simulator, (), channel_noise(log), places)
    theta = np.array([3.0, 0.4])
    states = States(np.array([[0.8]]), np.zeros((1, 1)), np.zeros((1, 0)))
    program = augmented_forces(Candidate(problem, Fit(model, theta, np.zeros((2, 2)), states, [], [], [], 2.0)))
    assert program is not None and len(program.splitlines()) <= 100
    (tmp_path / "augmented_forces.py").write_text(program)
    (tmp_path / "augmented.xml").write_text(CART)
    code = (
        "import mujoco, augmented_forces as f; m = mujoco.MjModel.from_xml_path('augmented.xml'); "
        "d = mujoco.MjData(m); d.qpos[0] = 0.8\nwhile d.time < 0.5 - 1e-9: f.step(m, d)\nprint(d.qpos[0])"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    own = simulator.predict(
        [Window(0, slice(0, 26), False)], [model.variant(mechanism, simulator.spec, theta)], [(0, 0)], states
    )
    assert float(run.stdout) == pytest.approx(own[0][-1, 0], abs=2e-3)
    subprocess.run([sys.executable, "augmented_forces.py"], cwd=tmp_path, capture_output=True, check=True)
