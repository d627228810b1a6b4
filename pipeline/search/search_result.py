"""The result of a search and the record of its best scenes."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from pipeline.errors import SimulationError
from pipeline.physics.batch import stack_scenes
from pipeline.physics.overlap import penetration, separated
from pipeline.scene.scene import Scene, half_extents
from pipeline.search.evaluator import Evaluator

DEEPEST = 1e-3  # m, the largest overlap of objects in a result


def parted(scene: Scene) -> Scene:
    """The scene with its objects moved apart; those that cannot be moved aside are lifted above the others."""
    scene = separated(scene)
    if penetration(scene) <= DEEPEST:
        return scene
    objects = list(scene.objects)
    for i in range(1, len(objects)):
        below = [o.position[2] + float(np.linalg.norm(half_extents(o))) for o in objects[:i]]
        if penetration(replace(scene, objects=tuple(objects[: i + 1]))) > DEEPEST:
            x, y, _ = objects[i].position
            objects[i] = replace(
                objects[i], position=(x, y, max(below) + float(np.linalg.norm(half_extents(objects[i]))))
            )
    return replace(scene, objects=tuple(objects))


@dataclass(frozen=True)
class SearchResult:
    """The best scene of a search and what it cost.

    Attributes:
        scene: The best scene.
        reward: Its reward.
        iou: Its IoU.
        spent: Numbers of simulations, in increasing order.
        history: Best reward after each of them.
        simulations: Simulations in all.
        invalid: Simulations that became unstable.
        seconds: Wall time.
        improved: Each scene that was the best so far, with the number of simulations before it.
    """

    scene: Scene
    reward: float
    iou: float
    spent: np.ndarray
    history: np.ndarray
    simulations: int
    invalid: int
    seconds: float
    improved: tuple[tuple[int, Scene], ...]

    def after(self, simulations: int) -> Scene:
        """The best scene after so many simulations."""
        known = [scene for spent, scene in self.improved if spent <= simulations]
        return known[-1] if known else self.improved[0][1]


class SearchRecord:
    """The best scene of a search so far. Its objects overlap by no more than `DEEPEST`."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self._before = evaluator.simulations, evaluator.invalid
        self._began = time.perf_counter()
        self.scene: Scene | None = None
        self.reward, self.iou = -np.inf, 0.0
        self._curve: list[tuple[int, float]] = []
        self._improved: list[tuple[int, Scene]] = []

    @property
    def simulations(self) -> int:
        return self._evaluator.simulations - self._before[0]

    def offer(self, scene: Scene, reward: float, iou: float, pairs: np.ndarray) -> None:
        """Keep the scene if it is the best. Objects that overlap are separated first, and the scene is evaluated again.

        Args:
            scene: The scene.
            reward: Its reward.
            iou: Its IoU.
            pairs: Objects and instances (P, 2) for another evaluation.
        """
        if reward <= self.reward:
            return
        if penetration(scene) > DEEPEST:
            scene = parted(scene)
            again = self._evaluator.rewards(stack_scenes([scene]), pairs)
            reward, iou = float(again.reward[0]), float(again.iou[0])
        if reward > self.reward:
            self.scene, self.reward, self.iou = scene, reward, iou
            self._improved.append((self.simulations, scene))

    def choose(self, scene: Scene, reward: float, iou: float) -> None:
        """Keep a scene whatever its reward. Its objects overlap by no more than `DEEPEST`."""
        assert penetration(scene) <= DEEPEST
        self.scene, self.reward, self.iou = scene, reward, iou
        self._improved.append((self.simulations, scene))

    def mark(self) -> None:
        """Add the present number of simulations and best reward to the history."""
        self._curve.append((self.simulations, self.reward))

    def result(self) -> SearchResult:
        if self.scene is None:
            raise SimulationError("the search found no scene: the simulation of each start is unstable")
        curve = np.array(self._curve, float).reshape(-1, 2)
        return SearchResult(
            scene=self.scene,
            reward=self.reward,
            iou=self.iou,
            spent=curve[:, 0].astype(int),
            history=curve[:, 1],
            simulations=self.simulations,
            invalid=self._evaluator.invalid - self._before[1],
            seconds=time.perf_counter() - self._began,
            improved=tuple(self._improved),
        )
