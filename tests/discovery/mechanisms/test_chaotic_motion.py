"""A model that is right follows a chaotic motion as far as the noise allows, with steps that do not matter."""

import mujoco
import numpy as np
import pandas as pd
import pytest

from pipeline.discovery.mechanisms.law_model import LawModel
from pipeline.discovery.mechanisms.least_squares import residuals
from pipeline.discovery.mechanisms.log import Log, read_log
from pipeline.discovery.mechanisms.longer_windows import states_of_longer
from pipeline.discovery.mechanisms.mechanism import Mechanism, read_mechanism
from pipeline.discovery.mechanisms.noise import channel_noise
from pipeline.discovery.mechanisms.places import places_of
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.search import MechanismSearch
from pipeline.discovery.mechanisms.simulation import Simulator, with_sensors
from pipeline.discovery.mechanisms.time_step import integrations, with_time_step
from pipeline.discovery.mechanisms.windows import guessed_states, halves, levels

DOUBLE_PENDULUM = """
<mujoco><option timestep="0.01"><flag contact="disable"/></option>
<default><joint axis="0 1 0" damping="0.001"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.5"/></default>
<worldbody><body><joint name="upper"/><geom/><body pos="0 0 -0.3"><joint name="lower"/><geom/></body></body></worldbody>
</mujoco>
"""
RATE, ROWS, NOISE = 100, 400, 1e-3


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Mechanism]:
    """A log of a double pendulum that goes over the top, and its model, whose own steps are long."""
    folder, rng, parts = tmp_path_factory.mktemp("chaos"), np.random.default_rng(5), []
    (folder / "model.xml").write_text(DOUBLE_PENDULUM)
    model = mujoco.MjModel.from_xml_string(DOUBLE_PENDULUM)
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    for clip in range(3):
        data, path = mujoco.MjData(model), []
        data.qpos[:] = rng.uniform(2.0, 3.0, 2)
        for _ in range(ROWS):
            path.append(data.qpos.copy())
            for _ in range(round(1 / RATE / model.opt.timestep)):
                mujoco.mj_step(model, data)
        seen = np.array(path) + rng.normal(0, NOISE, (ROWS, 2))
        time = np.arange(ROWS) / RATE
        parts.append(pd.DataFrame({"clip": f"clip_{clip}", "time": time, "upper": seen[:, 0], "lower": seen[:, 1]}))
    pd.concat(parts).to_csv(folder / "log.csv", index=False)
    mechanism = read_mechanism(folder / "model.xml")
    return read_log(folder / "log.csv", mechanism), mechanism


@pytest.fixture(scope="module")
def problems(read: tuple[Log, Mechanism]) -> list[Problem]:
    """The log in windows of growing length, simulated as the motion asks."""
    log, mechanism = read
    stated = Simulator(mechanism, log, with_sensors(mechanism.physics, log.channels))
    cuts = levels(log, halves(log, 0.3, np.random.default_rng(0)), 2 * mechanism.model.nv)
    whole = Problem(mechanism, log, stated, cuts[0], channel_noise(log), places_of(mechanism, log))
    near = whole.cut(cuts[3])
    motion = integrations(near, LawModel(()), np.zeros(0), guessed_states(mechanism, log, near.windows))[0]
    return [whole.cut(cut).simulated_by(motion) for cut in reversed(cuts)]


def test_the_right_model_leaves_nothing_but_noise_in_windows_of_any_length(problems: list[Problem]) -> None:
    found = MechanismSearch(tuple(problems), (), lambda _: None).climb(LawModel(()), np.zeros(0))
    assert len(found[-1].problem.windows) == 3
    assert max(c.variance for c in found) < 1.3


def test_longer_windows_begin_so_that_they_lead_through_the_states_of_the_shorter_ones(problems: list[Problem]) -> None:
    shorter, longer = problems[-2:]
    found = MechanismSearch(tuple(problems[:-1]), (), lambda _: None).climb(LawModel(()), np.zeros(0))[-1].fit
    alone = found.states.of([k for k, w in enumerate(shorter.windows) if w.rows.start == 0])
    led = states_of_longer(shorter, found, longer, guessed_states(longer.mechanism, longer.log, longer.windows))
    left = [sum(r @ r for r in residuals(longer, LawModel(()), np.zeros(0), s)) for s in (led, alone)]
    assert left[0] < 0.1 * left[1]


def test_the_steps_of_the_simulation_do_not_matter(problems: list[Problem]) -> None:
    problem = problems[3]
    simulator = problem.simulator
    spec = simulator.spec
    finer = Simulator(problem.mechanism, problem.log, with_time_step(spec, 0.25, int(spec.option.integrator)))
    states = guessed_states(problem.mechanism, problem.log, problem.windows)
    jobs = [(w, 0) for w in range(len(problem.windows))]
    variant = LawModel(()).variant(problem.mechanism, spec, np.zeros(0))
    fine = LawModel(()).variant(problem.mechanism, finer.spec, np.zeros(0))
    own = np.concatenate(simulator.predict(problem.windows, [variant], jobs, states))
    other = np.concatenate(finer.predict(problem.windows, [fine], jobs, states))
    assert np.sqrt(((own - other) ** 2).mean()) < 0.2 * NOISE
