"""The search of choice: descents of Gauss-Newton, and leaps object by object where they end.

1. From every start: the best of many variations is taken object by object, the first frames are matched, then more,
   then all (late frames mislead as long as early ones do not match).
   Chance enters into that, so that a budget with room for more islands than there are starts settles starts again.
2. Each island leaps: some of the objects that do not match yet are varied, go down with the camera fixed, and are kept,
   each group of objects that meet on its own, where they match better than before. With all coordinates free it goes
   down again. So on.
3. Each has an equal share of the budget, and the best of them what is left.

Leaps and descents go by the pooled residuals; the answer is what had the best reward on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.physics.batch import stack_scenes, unstack
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.gauss_newton import Descent, neighbours
from pipeline.search.jumps import moved
from pipeline.search.parameters import Space, search_space
from pipeline.search.search_result import Found, Record

VARIATIONS = 64
ALTERNATIVES = 6  # of the variations, of which a leap takes one
HORIZONS = (3, 6)  # of ten frames, matched before all are
STEPS = 3  # of Gauss-Newton before a horizon moves on
LEAP_STEPS = 5
MATCHED = 0.02  # cost of an object that needs no leap
ISLAND = 1600  # simulations to have for each island
LEADING = 0.25  # share of the budget that the best of them has alone
SETTLING = 500  # simulations to have for each island that has a start of its own
LEAST = 150  # simulations, below which nothing new is begun
SPARE = 8  # simulations kept back for looks at single scenes


@dataclass(frozen=True)
class Candidate:
    """A scene and the cost of each object (N,)."""

    scene: Scene
    cost: np.ndarray


class Island:
    """One start and where it got to by cost. pairs (P, 2): its objects to the target's instances; None: by overlap."""

    def __init__(
        self, evaluator: Evaluator, record: Record, budget: int, rng: np.random.Generator, start: Scene,
        pairs: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self._evaluator, self._record, self._budget, self._rng = evaluator, record, budget, rng
        self.pairs = evaluator.pairs(start) if pairs is None else pairs
        self.here = self._look(start)

    @property
    def _left(self) -> int:
        return self._budget - SPARE - self._record.simulations

    def _look(self, scene: Scene) -> Candidate:
        residuals, rewards = self._evaluator.residuals(stack_scenes([scene]), self.pairs)
        self._record.offer(scene, float(rewards.reward[0]), float(rewards.iou[0]), self.pairs)
        return Candidate(scene, residuals.cost[0])

    def settle(self) -> None:
        """From the start down."""
        movable = list(range(len(self.here.scene.objects)))
        if self._left > VARIATIONS:
            near = self.approach(self.vary(self.here.scene, movable, HORIZONS[0]), HORIZONS, camera=True)
            self._take(self._look(near))
            self._take(self.descend(search_space(near)))

    def _take(self, candidate: Candidate) -> None:
        if candidate.cost.sum() < self.here.cost.sum():
            self.here = candidate

    def vary(self, scene: Scene, movable: list[int], frames: int | None, leap: bool = False) -> Scene:
        """The scene with each movable object as in the best of many variations over the first frames; leap: as in one
        of the best that are not as it was."""
        batch = moved(self._rng, stack_scenes([scene]), max(2, min(VARIATIONS, self._left)), movable, leap)
        residuals, _ = self._evaluator.residuals(batch, self.pairs, frames)
        chosen = stack_scenes([scene])
        for i in movable:
            order = np.argsort(residuals.cost[:, i], kind="stable")
            if leap:
                order = order[order > 0][:ALTERNATIVES]
                self._rng.shuffle(order)
            chosen.copy_object(i, batch, int(order[0]))
        return unstack(chosen, 0, scene)

    def approach(self, scene: Scene, horizons: Sequence[int | None], camera: bool) -> Scene:
        """A few steps on the first frames alone, then on more (None: all)."""
        for frames in horizons:
            space = search_space(scene) if camera else search_space(scene).fixing_camera()
            run = Descent.start(self._evaluator, space, space.encode(), self.pairs, frames)
            for _ in range(STEPS):
                if run.done or self._left < run.most_simulations:
                    break
                run.step()
            scene = space.scene(run.point.x)
        return scene

    def descend(self, space: Space, most: int | None = None) -> Candidate:
        """Gauss-Newton over all frames; where it ends by cost. The best by reward goes on record."""
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

    def leap(self) -> None:
        """Leap with some of what does not match yet, and keep what got better."""
        here = self.here
        unmatched = [int(i) for i in np.flatnonzero(here.cost > MATCHED)] or [int(np.argmax(here.cost))]
        movable = [i for i in unmatched if self._rng.random() < 0.5] or [int(self._rng.choice(unmatched))]
        horizons = HORIZONS[int(self._rng.integers(len(HORIZONS) + 1)) :]
        leapt = self.vary(here.scene, movable, horizons[0] if horizons else None, leap=True)
        leapt = self.approach(leapt, horizons, camera=False)
        there = self.descend(search_space(leapt).fixing_camera(), LEAP_STEPS)
        groups = neighbours(self._evaluator, stack_scenes([here.scene]))
        better = [i for g in groups if there.cost[g].sum() < here.cost[g].sum() for i in g]
        if better:
            objects = (there.scene.objects[i] if i in better else o for i, o in enumerate(here.scene.objects))
            mixed = self._look(replace(here.scene, objects=tuple(objects)))
            self._take(mixed)
            self._take(self.descend(search_space(mixed.scene)))


def fit(
    evaluator: Evaluator,
    record: Record,
    starts: Sequence[Scene],
    simulations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda spent, reward: None,
) -> Found:
    """The best scene found from the starts, the most promising first, when `record` is at so many simulations.

    The answer is never worse than the best start that can be had without overlap. progress: called with the
    simulations spent and the best reward so far.
    """

    def leap(island: Island, end: float) -> None:
        while end - record.simulations >= LEAST:
            island.leap()
            progress(record.simulations, record.reward)

    left = simulations - record.simulations
    islands: list[Island] = []
    count = max(1, min(len(starts), left // SETTLING), left // ISLAND)
    for k, end in enumerate(record.simulations + (1 - LEADING) * left * np.arange(1, count + 1) / count):
        islands.append(Island(evaluator, record, simulations, rng, starts[k % len(starts)]))
        islands[-1].settle()
        progress(record.simulations, record.reward)
        leap(islands[-1], end)
    leap(min(islands, key=lambda i: float(i.here.cost.sum())), simulations)
    record.mark()
    return record.found()
