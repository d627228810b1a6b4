"""How well scenes replay a clip: as the search sees it, and as the metrics of docs/formats.md define it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.commands.clip_input import ClipInput
from pipeline.errors import SimulationError
from pipeline.metrics.overlap import assign, count, first_frame, foreground_iou, pair_iou, sequence_iou
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import Ranking, rank
from pipeline.search.evaluator import Evaluator
from pipeline.search.target import make_target

SEARCH_SIZE = (120, 80)  # px of masks and flow in the search's reward


@dataclass(frozen=True)
class Overlap:
    """IoU at the clip's own size: of the instances over the whole clip and in its first frame, and of everything that
    moves (docs/formats.md, "Metrics"); pairs (P, 2): object and instance that belong together."""

    sequence: float
    initial: float
    foreground: float
    pairs: np.ndarray


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def evaluator_of(clip: ClipInput) -> Evaluator:
    masks = clip.taken.masks[clip.schedule.pairs[:, 0]]
    return Evaluator(make_target(masks, clip.flow, *SEARCH_SIZE), clip.schedule, cores())


def ranked(evaluator: Evaluator, scenes: Sequence[Scene]) -> Ranking:
    """The scenes' ranking. Raises SimulationError where none of them can be simulated."""
    ranking = rank(evaluator, scenes)
    if not ranking.rewards.valid.any():
        raise SimulationError(f"the numbers go bad in each of the {len(scenes)} answers; try more --samples")
    return ranking


def overlap(masks: np.ndarray, objects: int, clip: ClipInput) -> Overlap:
    """Overlap of a replay's masks (F, H, W) with the clip's."""
    counts = count(masks, clip.taken.masks, objects, clip.objects)
    pairs, first = assign(pair_iou(counts)), first_frame(counts)
    return Overlap(
        float(sequence_iou(counts, pairs)),
        float(sequence_iou(first, assign(pair_iou(first)))),
        foreground_iou(counts),
        pairs,
    )


def relabelled(masks: np.ndarray, pairs: np.ndarray, objects: int) -> np.ndarray:
    """The clip's masks with each instance's id that of the object it is paired with; others come after the objects'."""
    table = np.zeros(256, np.uint8)
    table[pairs[:, 1] + 1] = pairs[:, 0] + 1
    alone = [j for j in range(1, int(masks.max(initial=0)) + 1) if not table[j]]
    for k, j in enumerate(alone):
        table[j] = min(objects + 1 + k, 255)
    return table[masks]
