"""The time steps with which a mechanism is simulated: those of its motion, and those that its model states.

A real mechanism has no time steps. So the steps become smaller until the predictions change by less than the noise. The
log may also be of a simulation, with the steps that the model states.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import Target
from pipeline.discovery.mechanisms.law_model import LawModel
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.simulation import Simulator, States

LONGEST, HALVINGS = 32.0, 9  # times the model's own step; how often steps are halved
EVALUATIONS = 4  # of the forces, in a step of Runge and Kutta's
SAME = 0.1  # of the noise, root mean square: predictions that differ by less are the same
DRY = 0.02  # of a joint's forces: dry friction that the trial has, whose reversals need the shortest steps
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


def with_time_step(spec: mujoco.MjSpec, factor: float, integrator: int) -> mujoco.MjSpec:
    """A copy of a document with another time step, by a factor, and another integrator."""
    out = spec.copy()
    out.option.timestep *= factor
    out.option.integrator = integrator
    return out


def integrations(problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> list[Simulator]:
    """Simulators with steps so small that they do not matter, and with stated steps, where these predict otherwise.

    In each of two families, the model's own integrator and Runge and Kutta's, steps are halved until that changes
    nothing, for noise of this size; the cheaper one is taken. Where neither gets that far, the most accurate one is.
    Tried on the first fitted window and the last one of all, with and without some dry friction at all joints.

    Args:
        problem: As the model states its step.
        model: Without effects.
        theta: (G,) its numbers.
        states: Where the windows begin.
    """
    tried = sorted({int(np.argmax(problem.chosen)), len(problem.windows) - 1})
    begin, spec = states.of(tried), problem.simulator.spec

    def predictions(simulator: Simulator) -> list[np.ndarray]:
        return _predictions(problem, simulator, model, theta, tried, begin)

    def halved(integrator: int) -> Iterator[tuple[float, Simulator, list[np.ndarray]]]:
        for factor in LONGEST / 2.0 ** np.arange(HALVINGS + 1):
            simulator = Simulator(problem.mechanism, problem.log, with_time_step(spec, factor, integrator))
            yield factor, simulator, predictions(simulator)

    found = []
    for integrator, cost in ((int(spec.option.integrator), 1), (RK4, EVALUATIONS)):
        for longer, shorter in itertools.pairwise(halved(integrator)):
            error = _apart(longer[2], shorter[2])
            found.append((max(error, SAME), cost / shorter[0], *shorter[1:]))
            if error < SAME:
                break
    *_, motion, shown = min(found, key=lambda one: one[:2])
    return [motion] if _apart(shown, predictions(problem.simulator)) < SAME else [motion, problem.simulator]


def _apart(some: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float:
    """Root mean square difference of predictions, in units of the noise; infinite where a motion diverges."""
    apart = np.concatenate([(a - b).ravel() for a, b in zip(some, others, strict=True)])
    return float(np.sqrt((apart**2).mean())) if np.isfinite(apart).all() else np.inf


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
