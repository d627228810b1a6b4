"""Best-of-K: simulate each sampled answer, compare it with the clip, and rank."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.physics.batch import fixed_kinds, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import INVALID_REWARD, Evaluator, Rewards


@dataclass(frozen=True)
class Ranking:
    """order (K,): indices of the candidates, best first. rewards: in the order of the candidates."""

    order: np.ndarray
    rewards: Rewards


def rank(evaluator: Evaluator, scenes: Sequence[Scene]) -> Ranking:
    """Rank scenes of any compositions by reward, ties by index. Each composition is evaluated as one batch."""
    groups: dict[tuple, list[int]] = defaultdict(list)
    for i, scene in enumerate(scenes):
        groups[scene.shapes, scene.ground is None, fixed_kinds(scene)].append(i)
    columns = {name: np.full(len(scenes), np.nan) for name in ("reward", "iou", "epe_frame", "epe")}
    valid = np.zeros(len(scenes), bool)
    for members in groups.values():
        part = evaluator.rewards(stack_scenes([scenes[i] for i in members]))
        for name, column in columns.items():
            column[members] = getattr(part, name)
        valid[members] = part.valid
    rewards = Rewards(valid=valid, **columns)
    return Ranking(np.argsort(-np.nan_to_num(rewards.reward, nan=INVALID_REWARD), kind="stable"), rewards)
