"""The time step of the simulation: as large as predictions allow, which stay those of the model's own settings.

A slow mechanism with a small step would be simulated in many times as many steps as its motion needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from pipeline.mechanisms.kind import Target
from pipeline.mechanisms.law_model import LawModel
from pipeline.mechanisms.problem import Problem
from pipeline.mechanisms.simulation import Simulator, States

LONGER = (32, 16, 8, 4, 2)  # times the model's own step, with Runge and Kutta's integrator
SAME = 0.3  # of the noise, root mean square: predictions that differ by less are the same
DRY = 0.02  # of a joint's forces: dry friction that the trial has, whose reversals need the shortest steps
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


def with_time_step(spec: mujoco.MjSpec, factor: float) -> mujoco.MjSpec:
    """A copy of a document with another time step, by a factor, and Runge and Kutta's integrator of fourth order."""
    out = spec.copy()
    out.option.timestep *= factor
    out.option.integrator = RK4
    return out


def longest_time_step(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> Problem:
    """The problem with the longest time step that predicts the same, for noise of this size.

    Tried on the first fitted window and the last one of all, with and without some dry friction at all joints.

    Args:
        problem: As the model states its step.
        model: Without effects.
        theta: (G,) its numbers.
        states: Where the windows begin.
    """
    tried = sorted({int(np.argmax(problem.chosen)), len(problem.windows) - 1})
    begin = states.of(tried)
    stated = _predictions(problem, problem.simulator, model, theta, tried, begin)
    if not all(np.isfinite(p).all() for p in stated):
        return problem
    for factor in LONGER:
        simulator = Simulator(problem.mechanism, problem.log, with_time_step(problem.simulator.spec, factor))
        other = _predictions(problem, simulator, model, theta, tried, begin)
        apart = np.concatenate([(a - b).ravel() for a, b in zip(stated, other, strict=True)])
        if np.isfinite(apart).all() and np.sqrt((apart**2).mean()) < SAME:
            return problem.simulated_by(simulator)
    return problem


def _predictions(
    problem: Problem, simulator: Simulator, model: LawModel, theta: np.ndarray, tried: Sequence[int], begin: States
) -> list[np.ndarray]:
    """Predictions of some windows in units of the noise, without and with dry friction."""
    document = model.document(simulator.spec, theta, with_controls=False)
    rough = document.copy()
    for place in problem.places[Target.JOINT]:
        rough.joint(place.name).frictionloss += DRY * place.torque
    out = []
    for spec in (document, rough):
        variant = LawModel(()).variant(problem.mechanism, spec, np.zeros(0))
        windows = [problem.windows[w] for w in tried]
        out += simulator.predict(windows, [variant], [(k, 0) for k in range(len(tried))], begin)
    return [p / problem.sigma for p in out]
