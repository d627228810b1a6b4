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
SHORTER = 0.25  # times the model's own step
SAME = 0.3  # of the noise, root mean square: predictions that differ by less are the same
DRY = 0.02  # of a joint's forces: dry friction that the trial has, whose reversals need the shortest steps
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


def with_time_step(spec: mujoco.MjSpec, factor: float, integrator: int) -> mujoco.MjSpec:
    """A copy of a document with another time step, by a factor, and another integrator."""
    out = spec.copy()
    out.option.timestep *= factor
    out.option.integrator = integrator
    return out


def integrations(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> list[Simulator]:
    """Simulators of the motion: as the model states, and others that predict something else.

    A real mechanism has no time steps, and the log of a simulation may have other ones. So Runge and Kutta's
    integrator, and a quarter of the stated step, are hypotheses as well. Where the stated one predicts the same with
    a longer step, for noise of this size, it is simulated so. Tried on the first fitted window and the last one of all,
    with and without some dry friction at all joints.

    Args:
        problem: As the model states its step.
        model: Without effects.
        theta: (G,) its numbers.
        states: Where the windows begin.
    """
    tried = sorted({int(np.argmax(problem.chosen)), len(problem.windows) - 1})
    begin, spec = states.of(tried), problem.simulator.spec
    own = int(spec.option.integrator)

    def predictions(simulator: Simulator) -> list[np.ndarray]:
        return _predictions(problem, simulator, model, theta, tried, begin)

    def simulator(factor: float, integrator: int) -> Simulator:
        return Simulator(problem.mechanism, problem.log, with_time_step(spec, factor, integrator))

    stated = predictions(problem.simulator)
    longer = (simulator(factor, RK4) for factor in LONGER)
    found = [next((s for s in longer if _same(predictions(s), stated)), problem.simulator)]
    seen = [stated]
    for factor, integrator in ((1.0, RK4), (SHORTER, own)):
        other = simulator(factor, integrator)
        shown = predictions(other)
        if all(np.isfinite(p).all() for p in shown) and not any(_same(shown, p) for p in seen):
            found.append(other)
            seen.append(shown)
    return found


def _same(some: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> bool:
    """Whether predictions, in units of the noise, are the same to within it."""
    apart = np.concatenate([(a - b).ravel() for a, b in zip(some, others, strict=True)])
    return bool(np.isfinite(apart).all() and np.sqrt((apart**2).mean()) < SAME)


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
