"""What a search comes back with, and what it cost."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.physics.overlap import penetration, separated
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator

DEEPEST = 1e-3  # m of overlap that an answer may have


@dataclass(frozen=True)
class Found:
    """The best scene, its reward and IoU; spent, history: simulations, and the best reward after so many; the cost.
    improved: each best scene on the way, and after how many simulations it was found."""

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
        """The best scene that a search of so many simulations would have come back with."""
        known = [scene for spent, scene in self.improved if spent <= simulations]
        return known[-1] if known else self.improved[0][1]


class Record:
    """The best answer so far of a search: none whose objects overlap by more than DEEPEST."""

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

    def offer(self, scene: Scene, reward: float, iou: float, pairs: np.ndarray | None = None) -> None:
        """Keep the scene if it is the best; one that overlaps is parted first, and looked at again."""
        if reward <= self.reward:
            return
        if penetration(scene) > DEEPEST:
            scene = separated(scene)
            if penetration(scene) > DEEPEST:
                return
            again = self._evaluator.rewards(stack_scenes([scene]), pairs)
            reward, iou = float(again.reward[0]), float(again.iou[0])
        if reward > self.reward:
            self.scene, self.reward, self.iou = scene, reward, iou
            self._improved.append((self.simulations, scene))

    def mark(self) -> None:
        """Note how good the best is by now."""
        self._curve.append((self.simulations, self.reward))

    def found(self) -> Found:
        assert self.scene is not None, "a search has a start"
        curve = np.array(self._curve, float).reshape(-1, 2)
        return Found(self.scene, self.reward, self.iou, curve[:, 0].astype(int), curve[:, 1], self.simulations,
                     self._evaluator.invalid - self._before[1], time.perf_counter() - self._began,
                     tuple(self._improved))  # fmt: skip
