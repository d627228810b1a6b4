"""CMA-ES (pycma) from the best sampled answers. Shapes are fixed, all other parameters are free within bounds."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.parameters import Space, search_space
from pipeline.search.search_result import SearchRecord, SearchResult


@dataclass(frozen=True)
class Budget:
    """population: candidates per iteration. iterations: in all, shared by the starts. sigma: initial step."""

    population: int
    iterations: int
    sigma: float


def mirrored(x: np.ndarray) -> np.ndarray:
    """Vectors (B, D) reflected into [0, 1].

    The bounds of pycma are applied candidate by candidate, which takes a fifth of the time of a generation.
    """
    return np.abs((x + 1) % 2 - 1)


class _Run:
    """One CMA-ES run from one start, advanced an iteration at a time."""

    def __init__(
        self, evaluator: Evaluator, start: Scene, budget: Budget, rng: np.random.Generator, record: SearchRecord
    ) -> None:
        self._evaluator, self._record = evaluator, record
        self._space: Space = search_space(start)
        self._pairs = evaluator.pairs(start)
        first = evaluator.rewards(stack_scenes([start]), self._pairs)
        self.reward = float(first.reward[0])
        record.offer(start, self.reward, float(first.iou[0]), self._pairs)
        options = {
            "popsize": budget.population,
            "seed": np.nan,  # keeps pycma from seeding NumPy's global generator; `randn` replaces it
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pycma warns about missing optional packages
            import cma  # here: it imports matplotlib, which takes a second

            self._es = cma.CMAEvolutionStrategy(self._space.encode(), budget.sigma, options)

    def step(self) -> None:
        vectors = self._es.ask()
        inside = mirrored(np.array(vectors))
        rewards = self._evaluator.rewards(self._space.decode(inside), self._pairs)
        self._es.tell(vectors, list(-rewards.reward))
        top = int(np.argmax(rewards.reward))
        self.reward = max(self.reward, float(rewards.reward[top]))
        if rewards.reward[top] > self._record.reward:
            self._record.offer(
                self._space.scene(inside[top]), float(rewards.reward[top]), float(rewards.iou[top]), self._pairs
            )


def cmaes_search(
    evaluator: Evaluator,
    starts: Sequence[Scene],
    budget: Budget,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda iteration, reward: None,
) -> SearchResult:
    """Search from several starts by CMA-ES.

    Half of the iterations are divided equally among the starts. The rest goes to the one that is best at the time. The
    result is never worse than the best start.

    Args:
        evaluator: Evaluates candidates.
        starts: Scenes.
        budget: Population, iterations and initial step.
        rng: Random generator.
        progress: Called with the iteration and the best reward so far.
    """
    record = SearchRecord(evaluator)
    runs = [_Run(evaluator, start, budget, rng, record) for start in starts]
    trial = budget.iterations // 2 // len(runs) if len(runs) > 1 else 0
    plan = [run for run in runs for _ in range(trial)]
    for iteration in range(budget.iterations):
        run = plan[iteration] if iteration < len(plan) else max(runs, key=lambda r: r.reward)
        run.step()
        record.mark()
        progress(iteration + 1, record.reward)
    return record.result()
