"""Candidate scenes in, rewards out: the one evaluator behind best-of-K, CMA-ES and preference ranking."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.evaluation.overlap_scores import assign, pair_iou, sequence_iou
from pipeline.physics.batch import BatchSimulator, SceneBatch
from pipeline.search.reward import Measured, measure_kernel
from pipeline.search.target import REFERENCE_WIDTH, Target
from pipeline.vision.surface import KINDS

INVALID_REWARD = -100.0


@dataclass(frozen=True)
class Rewards:
    """reward = iou - epe_frame (B,), px of 480x320 per frame interval; valid (B,): False where the numbers went bad,
    with `INVALID_REWARD`."""

    reward: np.ndarray
    iou: np.ndarray
    epe_frame: np.ndarray
    epe: np.ndarray
    valid: np.ndarray


class Evaluator:
    """Rewards of candidates against one target.

    threads: for simulation and rendering alike. Compositions already seen are not compiled again.
    """

    def __init__(self, target: Target, schedule: Schedule, threads: int) -> None:
        self.target, self.schedule, self.threads = target, schedule, threads
        steps = schedule.frame_steps[schedule.pairs]  # (F, 2)
        self._steps, self._inverse = np.unique(steps, return_inverse=True)
        self._inverse = self._inverse.reshape(steps.shape)
        self._simulators: dict[tuple[tuple[str, ...], bool, int], BatchSimulator] = {}
        self.simulations = 0
        self.invalid = 0

    def measure(self, scenes: SceneBatch) -> tuple[Measured, np.ndarray]:
        """What the candidates' replays share with the target, and (B,) whether each run was sound."""
        count, objects = scenes.mass.shape
        key = (scenes.shapes, not np.isnan(scenes.ground[0]), 1 << (count - 1).bit_length())
        if key not in self._simulators:
            self._simulators[key] = BatchSimulator(*key, self.threads)
        states = self._simulators[key].run(scenes, self._steps)
        self.simulations += count
        self.invalid += int((~states.valid).sum())
        frames, instances = len(self._inverse), self.target.instances
        out = Measured(
            np.zeros((count, frames, objects, instances), np.int64),
            np.zeros((count, frames, objects), np.int64),
            np.zeros((count, frames, instances), np.int64),
            np.zeros((count, frames, 2), np.int64),
            np.zeros(count),
            np.zeros(count),
        )
        kinds = np.array([KINDS[s] for s in scenes.shapes])
        numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
        measure_kernel(
            kinds, scenes.half_size,
            np.ascontiguousarray(states.position[:, self._inverse]),
            np.ascontiguousarray(states.quaternion[:, self._inverse]),
            scenes.camera_position, np.ascontiguousarray(scenes.camera_rotation), scenes.fov, scenes.ground,
            self.target.masks, self.target.flow,
            out.shared, out.predicted, out.true, out.foreground, out.epe_frame, out.epe,
        )  # fmt: skip
        return out, states.valid

    def rewards(self, scenes: SceneBatch, pairs: np.ndarray | None = None) -> Rewards:
        """Rewards of the candidates; pairs (P, 2): the same objects to instances for all, else the best for each."""
        measured, valid = self.measure(scenes)
        iou = np.empty(len(scenes))
        for b in range(len(scenes)):
            counts = measured.counts(b)
            iou[b] = sequence_iou(counts, assign(pair_iou(counts)) if pairs is None else pairs)
        scale = REFERENCE_WIDTH / self.target.width
        epe_frame = measured.epe_frame * scale
        reward = np.where(valid, iou - epe_frame, INVALID_REWARD)
        return Rewards(reward, iou, epe_frame, measured.epe * scale, valid)
