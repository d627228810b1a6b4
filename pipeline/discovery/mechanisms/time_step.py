"""The time steps with which a mechanism is simulated: those of its motion, and those that its model states.

A real mechanism has no time steps. So the steps become smaller until the predictions change by less than the noise. The
log may also be of a simulation, with the steps that the model states.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.kind import Target
from pipeline.discovery.mechanisms.law_model import LawModel
from pipeline.discovery.mechanisms.least_squares import derivatives_by_states, motions
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.simulation import Simulator, States

LONGEST, HALVINGS = 32.0, 9  # times the model's own step; how often steps are halved
EVALUATIONS = 4  # of the forces, in a step of Runge and Kutta's
SAME = 0.1  # of the noise, root mean square: predictions that differ by less are the same
DRY = 0.02  # of a joint's forces: dry friction that the trial has, whose reversals need the shortest steps
PLAIN = LawModel(())  # nothing beside what a document says
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
    Tried on the first fitted window and the last one of all, with and without some dry friction at all joints. What
    another initial state of a window makes up for does not count: in chaotic motion that is most of the change.

    Args:
        problem: As the model states its step.
        model: Without effects.
        theta: (G,) its numbers.
        states: Where the windows begin.
    """
    some = sorted({int(np.argmax(problem.chosen)), len(problem.windows) - 1})
    tried, begin = problem.cut(tuple(problem.windows[w] for w in some)), states.of(some)
    documents = _documents(problem, model, theta)
    slopes = [own for spec in documents for own in derivatives_by_states(_with(tried, spec), PLAIN, theta[:0], begin)]

    def predictions(factor: float, integrator: int) -> list[np.ndarray]:
        out: list[np.ndarray] = []
        for spec in documents:
            out += motions(_with(tried, with_time_step(spec, factor, integrator)), PLAIN, theta[:0], begin)
        return out

    def apart(some: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float:
        """Root mean square difference of predictions; infinite where a motion diverges."""
        changes = [a - b for a, b in zip(some, others, strict=True)]
        if not np.isfinite(np.concatenate(changes)).all():
            return np.inf
        left = np.concatenate([_not_absorbed(c, own) for c, own in zip(changes, slopes, strict=True)])
        return float(np.sqrt((left**2).mean()))

    stated = int(problem.simulator.spec.option.integrator)
    found = []
    for integrator, cost in {stated: 1, RK4: EVALUATIONS}.items():
        factors = LONGEST / 2.0 ** np.arange(HALVINGS + 1)
        for longer, (factor, shorter) in itertools.pairwise((f, predictions(f, integrator)) for f in factors):
            error = apart(longer[1], shorter)
            found.append((max(error, SAME), cost / factor, factor, integrator, shorter))
            if error < SAME:
                break
    *_, factor, integrator, shown = min(found, key=lambda one: one[:2])
    motion = _with(problem, with_time_step(problem.simulator.spec, factor, integrator)).simulator
    return [motion] if apart(shown, predictions(1.0, stated)) < SAME else [motion, problem.simulator]


def _documents(problem: Problem, model: LawModel, theta: np.ndarray) -> list[mujoco.MjSpec]:
    """The model, and the model with some dry friction at all joints."""
    plain = model.document(problem.simulator.spec, theta, with_controls=False)
    rough = plain.copy()
    for place in problem.places[Target.JOINT]:
        rough.joint(place.name).frictionloss += DRY * place.torque
    return [plain, rough]


def _with(problem: Problem, spec: mujoco.MjSpec) -> Problem:
    """The problem, simulated by another document."""
    return problem.simulated_by(Simulator(problem.mechanism, problem.log, spec))


def _not_absorbed(change: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """The part of a change (numbers,) of predictions that no change of the initial state makes, to first order.

    slopes: (L, numbers), derivatives by the initial state.
    """
    return np.asarray(change - slopes.T @ np.linalg.lstsq(slopes.T, change, rcond=None)[0])
