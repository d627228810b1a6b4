"""The default search: basin hopping, with Gauss-Newton descents and random jumps of single objects.

1. Each run begins with a start. For each object the best of many random variations is taken. Then Gauss-Newton matches
   the first frames, then more, then all: late frames mislead as long as early ones do not match. This is random, so a
   budget for more runs than there are starts uses starts again.
2. The run jumps. Some of the objects that do not match yet are varied and descend with the camera fixed. Each group of
   objects that meet is kept where it matches better than before. Then all coordinates descend. This is repeated.
3. Each run has an equal share of the budget. The best run gets the rest.

Jumps and descents minimise the residuals, and the result is the scene of least cost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.physics.batch import stack_scenes, unstack
from pipeline.physics.overlap import penetration
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.gauss_newton import Descent, neighbours
from pipeline.search.jumps import propose_jumps
from pipeline.search.parameters import Space, search_space
from pipeline.search.search_result import DEEPEST, SearchRecord, SearchResult, parted

VARIATIONS = 64  # random variations of each object
ALTERNATIVES = 6  # best variations from which a jump draws one
HORIZONS = (3, 6)  # numbers of first frames, of ten, that are matched before all are
HORIZON_STEPS = 3  # Gauss-Newton steps per horizon
JUMP_STEPS = 5  # Gauss-Newton steps after a jump
MATCHED = 0.02  # cost of an object up to which it does not jump
RUN_SIMULATIONS = 1600  # budget of simulations that justifies one more run
BEST_RUN_SHARE = 0.25  # share of the budget for the best run alone
START_SIMULATIONS = 500  # budget of simulations that justifies a run from one more start
LEAST_SIMULATIONS = 150  # remaining simulations below which no jump is begun
UNMATCHED = 10.0  # cost of an object without an instance, and of an instance without an object
SPARE = 8  # simulations in reserve for evaluations of single scenes


@dataclass(frozen=True)
class Candidate:
    """A scene and the cost of each of its objects (N,)."""

    scene: Scene
    cost: np.ndarray


class BasinHopping:
    """One run from one start, with the scene of the least cost so far.

    Args:
        evaluator: Evaluates candidates.
        record: Keeps the best scene by reward.
        budget: Simulations of `record` at which the run stops.
        rng: Random generator.
        start: First scene.
    """

    def __init__(
        self, evaluator: Evaluator, record: SearchRecord, budget: int, rng: np.random.Generator, start: Scene
    ) -> None:
        self._evaluator, self._record, self._budget, self._rng = evaluator, record, budget, rng
        self.pairs = evaluator.pairs(start)
        self.best = self._evaluate(start)

    @property
    def _left(self) -> int:
        return self._budget - SPARE - self._record.simulations

    def _evaluate(self, scene: Scene) -> Candidate:
        residuals, rewards = self._evaluator.residuals(stack_scenes([scene]), self.pairs)
        self._record.offer(scene, float(rewards.reward[0]), float(rewards.iou[0]), self.pairs)
        return Candidate(scene, residuals.cost[0])

    def descend_from_start(self) -> None:
        """Take the best variation of each object, match the first frames, then all."""
        movable = list(range(len(self.best.scene.objects)))
        if self._left > VARIATIONS:
            near = self.match_first_frames(self.vary(self.best.scene, movable, HORIZONS[0]), HORIZONS, camera=True)
            self._keep_better(self._evaluate(near))
            self._keep_better(self.descend(search_space(near)))

    def _keep_better(self, candidate: Candidate) -> None:
        if candidate.cost.sum() < self.best.cost.sum():
            self.best = candidate

    def vary(self, scene: Scene, movable: list[int], frames: int | None, jump: bool = False) -> Scene:
        """The scene with random variations of some of its objects.

        Args:
            scene: The scene.
            movable: Indices of the objects that are varied.
            frames: Number of first frames by which variations are compared; None: all.
            jump: Take one of the `ALTERNATIVES` best variations that differ from the scene, instead of the best.
        """
        batch = propose_jumps(self._rng, stack_scenes([scene]), max(2, min(VARIATIONS, self._left)), movable, jump)
        residuals, _ = self._evaluator.residuals(batch, self.pairs, frames)
        chosen = stack_scenes([scene])
        for i in movable:
            order = np.argsort(residuals.cost[:, i], kind="stable")
            if jump:
                order = order[order > 0][:ALTERNATIVES]
                self._rng.shuffle(order)
            chosen.copy_object(i, batch, int(order[0]))
        return unstack(chosen, 0, scene)

    def match_first_frames(self, scene: Scene, horizons: Sequence[int | None], camera: bool) -> Scene:
        """A few Gauss-Newton steps on each number of first frames (None: all). camera: whether it is free."""
        for frames in horizons:
            space = search_space(scene) if camera else search_space(scene).fixing_camera()
            run = Descent.start(self._evaluator, space, space.encode(), self.pairs, frames)
            for _ in range(HORIZON_STEPS):
                if run.done or self._left < run.most_simulations:
                    break
                run.step()
            scene = space.scene(run.point.x)
        return scene

    def descend(self, space: Space, most: int | None = None) -> Candidate:
        """Gauss-Newton over all frames, for at most `most` steps. The best scene by reward is recorded."""
        run = Descent.start(self._evaluator, space, space.encode(), self.pairs)
        steps = 0
        while not run.done and self._left >= run.most_simulations and (most is None or steps < most):
            run.step()
            steps += 1
        best = run.best
        if best.reward > self._record.reward:
            self._record.offer(space.scene(best.x), best.reward, best.iou, self.pairs)
        self._record.mark()
        return Candidate(space.scene(run.point.x), run.point.cost)

    def jump(self) -> None:
        """Vary some of the objects that do not match, descend, and keep those that improved."""
        here = self.best
        unmatched = [int(i) for i in np.flatnonzero(here.cost > MATCHED)] or [int(np.argmax(here.cost))]
        movable = [i for i in unmatched if self._rng.random() < 0.5] or [int(self._rng.choice(unmatched))]
        horizons = HORIZONS[int(self._rng.integers(len(HORIZONS) + 1)) :]
        jumped = self.vary(here.scene, movable, horizons[0] if horizons else None, jump=True)
        jumped = self.match_first_frames(jumped, horizons, camera=False)
        there = self.descend(search_space(jumped).fixing_camera(), JUMP_STEPS)
        groups = neighbours(self._evaluator, stack_scenes([here.scene]))
        better = [i for g in groups if there.cost[g].sum() < here.cost[g].sum() for i in g]
        if better:
            objects = (there.scene.objects[i] if i in better else o for i, o in enumerate(here.scene.objects))
            mixed = self._evaluate(replace(here.scene, objects=tuple(objects)))
            self._keep_better(mixed)
            self._keep_better(self.descend(search_space(mixed.scene)))


def loss(evaluator: Evaluator, scene: Scene, cost: np.ndarray, pairs: np.ndarray) -> float:
    """The cost of a scene, with `UNMATCHED` for each object or instance without a partner."""
    alone = len(scene.objects) + evaluator.target.instances - 2 * len(pairs)
    return float(cost.sum()) + UNMATCHED * alone


def choose_least_cost(evaluator: Evaluator, record: SearchRecord, runs: Sequence[BasinHopping]) -> None:
    """Let the result be the run's best scene with the least loss, if that is less than the loss of the best by reward.

    The reward counts pixels of small masks; near the end, outlines at the clip's resolution tell more.
    """
    best = min(runs, key=lambda run: loss(evaluator, run.best.scene, run.best.cost, run.pairs))
    scene = parted(best.best.scene)
    residuals, rewards = evaluator.residuals(stack_scenes([scene]), best.pairs)
    if penetration(scene) > DEEPEST or not rewards.valid[0]:
        return
    if record.scene is not None:
        pairs = evaluator.pairs(record.scene)
        kept, _ = evaluator.residuals(stack_scenes([record.scene]), pairs)
        if loss(evaluator, record.scene, kept.cost[0], pairs) <= loss(evaluator, scene, residuals.cost[0], best.pairs):
            return
    record.choose(scene, float(rewards.reward[0]), float(rewards.iou[0]))


def fit_scene(
    evaluator: Evaluator,
    record: SearchRecord,
    starts: Sequence[Scene],
    simulations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda spent, reward: None,
) -> SearchResult:
    """Search from given starts until the budget is spent.

    The result is never worse than the best start whose objects can be separated.

    Args:
        evaluator: Evaluates candidates.
        record: Keeps the best scene by reward; the simulations that it has counted already are part of the budget.
        starts: Scenes, the most promising first.
        simulations: The budget.
        rng: Random generator.
        progress: Called with the simulations spent and the best reward so far.
    """

    def jump_until(run: BasinHopping, end: float) -> None:
        while end - record.simulations >= LEAST_SIMULATIONS:
            run.jump()
            progress(record.simulations, record.reward)

    left = simulations - record.simulations
    runs: list[BasinHopping] = []
    count = max(1, min(len(starts), left // START_SIMULATIONS), left // RUN_SIMULATIONS)
    for k, end in enumerate(record.simulations + (1 - BEST_RUN_SHARE) * left * np.arange(1, count + 1) / count):
        runs.append(BasinHopping(evaluator, record, simulations, rng, starts[k % len(starts)]))
        runs[-1].descend_from_start()
        progress(record.simulations, record.reward)
        jump_until(runs[-1], end)
    jump_until(min(runs, key=lambda run: float(run.best.cost.sum())), simulations)
    record.mark()
    choose_least_cost(evaluator, record, runs)
    return record.result()
