"""CMA-ES (pycma) from the best sampled answers: types fixed, everything else bounded and free."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cma
import numpy as np

from pipeline.evaluation.overlap_scores import assign, pair_iou
from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.parameters import Space, search_space


@dataclass(frozen=True)
class Budget:
    """population candidates an iteration, iterations in all (shared by the starts), first step sigma."""

    population: int
    iterations: int
    sigma: float


@dataclass(frozen=True)
class Found:
    """The best scene, its reward and IoU, the best reward after each iteration, and what it cost."""

    scene: Scene
    reward: float
    iou: float
    history: np.ndarray
    simulations: int
    invalid: int
    seconds: float


class _Run:
    """One CMA-ES run from one start, advanced an iteration at a time."""

    def __init__(self, evaluator: Evaluator, start: Scene, budget: Budget, rng: np.random.Generator) -> None:
        self._evaluator = evaluator
        self._space: Space = search_space(start)
        measured, _ = evaluator.measure(stack_scenes([start]))
        self._pairs = assign(pair_iou(measured.counts(0)))
        first = evaluator.rewards(stack_scenes([start]), self._pairs)
        self.best, self.reward, self.iou = start, float(first.reward[0]), float(first.iou[0])
        options = {
            "popsize": budget.population,
            "bounds": [0, 1],
            "seed": np.nan,  # pycma leaves NumPy's global generator alone; its numbers come from ours
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pycma's remarks on optional packages
            self._es = cma.CMAEvolutionStrategy(self._space.encode(), budget.sigma, options)

    def step(self) -> None:
        vectors = self._es.ask()
        scenes = self._space.decode(np.array(vectors))
        rewards = self._evaluator.rewards(stack_scenes(scenes), self._pairs)
        self._es.tell(vectors, list(-rewards.reward))
        top = int(np.argmax(rewards.reward))
        if rewards.reward[top] > self.reward:
            self.best, self.reward, self.iou = scenes[top], float(rewards.reward[top]), float(rewards.iou[top])


def search(
    evaluator: Evaluator,
    starts: Sequence[Scene],
    budget: Budget,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda iteration, reward: None,
) -> Found:
    """The best scene found from any of the starts.

    Half of the iterations are shared out evenly among the starts, the rest goes to the one that leads then. The
    answer is never worse than the best start. progress: called with the iteration and the best reward so far.
    """
    began, simulations, invalid = time.perf_counter(), evaluator.simulations, evaluator.invalid
    runs = [_Run(evaluator, start, budget, rng) for start in starts]
    history: list[float] = []
    trial = budget.iterations // 2 // len(runs) if len(runs) > 1 else 0
    plan = [run for run in runs for _ in range(trial)]
    for iteration in range(budget.iterations):
        if iteration < len(plan):
            run = plan[iteration]
        else:
            run = max(runs, key=lambda r: r.reward)
        run.step()
        history.append(max(r.reward for r in runs))
        progress(iteration + 1, history[-1])
    best = max(runs, key=lambda r: r.reward)
    return Found(best.best, best.reward, best.iou, np.array(history), evaluator.simulations - simulations,
                 evaluator.invalid - invalid, time.perf_counter() - began)  # fmt: skip
