"""Evaluates candidate scenes against a target: by rewards, and by residuals for Gauss-Newton."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from pipeline.clips.overlap import assign, pair_iou, sequence_iou
from pipeline.clips.schedule import Schedule
from pipeline.physics.batch import BatchSimulator, FixedKind, SceneBatch, States, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.outlines.outline_residuals import OutlineTarget
from pipeline.search.pooled_residuals import PooledTarget, Residuals
from pipeline.search.reward import Measured, Totals, measure_kernel
from pipeline.search.target import REFERENCE_AREA, Target
from pipeline.vision.rendering.surface import FIXED_KINDS, KINDS

INVALID_REWARD = -100.0


@dataclass(frozen=True)
class Rewards:
    """Rewards of B candidates.

    Attributes:
        reward: (B,) iou - epe_frame; `INVALID_REWARD` where the simulation became unstable.
        iou: (B,) sequence IoU.
        epe_frame: (B,) mean end-point error over the whole frame, px of 480x320 per frame interval.
        epe: (B,) mean end-point error over the foreground, in the same unit.
        valid: (B,) whether the simulation was stable.
    """

    reward: np.ndarray
    iou: np.ndarray
    epe_frame: np.ndarray
    epe: np.ndarray
    valid: np.ndarray


class Evaluator:
    """Evaluates candidates against one target. Each composition is compiled once.

    Args:
        target: Masks and flow to match; flow leads from the first frame of each of the schedule's pairs to the second.
        schedule: Times of the target's frames.
        threads: For simulation and rendering.
        outlines: Of the clip; None: of the target's own masks.
    """

    def __init__(self, target: Target, schedule: Schedule, threads: int, outlines: ClipOutlines | None = None) -> None:
        self.target, self.schedule, self.threads = target, schedule, threads
        self.outlines = outlines or ClipOutlines(target.masks, self.times, target.instances)
        steps = schedule.frame_steps[schedule.pairs]  # (F, 2)
        self._steps, self._inverse = np.unique(steps, return_inverse=True)
        self._inverse = self._inverse.reshape(steps.shape)
        self._simulators: dict[tuple[tuple[str, ...], bool, int, tuple[FixedKind, ...]], BatchSimulator] = {}
        self._pooled_target, self._totals = PooledTarget(target), Totals.of(target)
        self._outlined = True
        self.simulations = 0
        self.invalid = 0

    def without_outlines(self) -> Evaluator:
        """An evaluator of the same target whose residuals are those of pooled masks and flow alone."""
        other = copy(self)
        other._outlined = False
        return other

    @cached_property
    def _outline_target(self) -> OutlineTarget:
        frames = np.searchsorted(self.outlines.times, self.times - 1e-6)
        return OutlineTarget(self.outlines.contours, frames, self.outlines.height)

    @property
    def times(self) -> np.ndarray:
        """(F,) s, of the target's frames."""
        return self.schedule.times[self.schedule.pairs[:, 0]]

    def replay(self, scenes: SceneBatch, frames: int | None = None) -> States:
        """Simulate the candidates.

        Returns poses (B, T, N, …) at the times of the first `frames` frames (None: all) and of the frames to which
        their flow leads.
        """
        count = len(scenes)
        shapes, fixed, size = scenes.shapes, scenes.fixed_kinds, 1 << (count - 1).bit_length()
        key = (shapes, scenes.has_ground, size, fixed)
        if key not in self._simulators:
            self._simulators[key] = BatchSimulator(shapes, scenes.has_ground, size, self.threads, fixed)
        states = self._simulators[key].run(scenes, self._steps[: int(self._inverse[:frames].max()) + 1])
        self.simulations += count
        self.invalid += int((~states.valid).sum())
        return states

    def measure(self, scenes: SceneBatch, pooled: bool = False, first: int | None = None) -> tuple[Measured, States]:
        """Simulate and render the candidates, and compare them with the target.

        Args:
            scenes: B candidates of one composition.
            pooled: Also compute the pooled masks and flow.
            first: Number of first frames to compare; None: all.

        Returns:
            The comparison, and the simulated states.
        """
        count, objects = scenes.mass.shape
        states = self.replay(scenes, first)
        inverse, instances = self._inverse[:first], self.target.instances
        frames = len(inverse)
        out = Measured(
            shared=np.zeros((count, frames, objects, instances), np.int64),
            predicted=np.zeros((count, frames, objects), np.int64),
            true=np.zeros((count, frames, instances), np.int64),
            foreground=np.zeros((count, frames, 2), np.int64),
            epe_frame=np.zeros(count),
            epe=np.zeros(count),
            pooled=np.zeros((count if pooled else 0, frames, objects, *self._pooled_target.shape), np.float32),
        )
        totals = self._totals
        kinds = np.array([KINDS[s] for s in scenes.shapes])
        numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
        measure_kernel(
            kinds,
            scenes.half_size,
            np.ascontiguousarray(states.position[:, inverse]),
            np.ascontiguousarray(states.quaternion[:, inverse]),
            scenes.camera_position,
            np.ascontiguousarray(scenes.camera_rotation),
            scenes.fov,
            scenes.ground,
            np.array([FIXED_KINDS[k.shape] for k in scenes.fixed_kinds], np.int64),
            scenes.fixed_half_size,
            scenes.fixed_position,
            scenes.fixed_quaternion,
            self.target.masks[:first],
            self.target.flow[:first],
            totals.area,
            totals.foreground,
            totals.speed,
            totals.speed_frame,
            totals.speed_foreground,
            self._pooled_target.cell,
            out.shared,
            out.predicted,
            out.true,
            out.foreground,
            out.epe_frame,
            out.epe,
            out.pooled,
        )
        return out, states

    def pairs(self, scene: Scene) -> np.ndarray:
        """(P, 2): pairs of an object of the scene and an instance of the target, assigned by overlap."""
        measured, _ = self.measure(stack_scenes([scene]))
        return assign(pair_iou(measured.counts(0)))

    def rewards(self, scenes: SceneBatch, pairs: np.ndarray | None = None) -> Rewards:
        """Rewards of the candidates. pairs (P, 2): objects and instances for all; None: the best for each."""
        measured, states = self.measure(scenes)
        return self._rewards(measured, states.valid, pairs)

    def residuals(self, scenes: SceneBatch, pairs: np.ndarray, first: int | None = None) -> tuple[Residuals, Rewards]:
        """Residuals, of pooled masks and flow and of outlines, and rewards of the candidates.

        Args:
            scenes: B candidates of one composition.
            pairs: (P, 2) objects and instances.
            first: Number of first frames to compare; None: all.
        """
        measured, states = self.measure(scenes, pooled=True, first=first)
        found = self._pooled_target.residuals(measured.pooled, pairs, states.valid)
        if self._outlined:
            at = self._inverse[:first, 0]
            found = found.joined(
                self._outline_target.residuals(scenes, states.position[:, at], states.quaternion[:, at], pairs)
            )
        return found, self._rewards(measured, states.valid, pairs)

    def _rewards(self, measured: Measured, valid: np.ndarray, pairs: np.ndarray | None) -> Rewards:
        if pairs is None:
            each = [measured.counts(b) for b in range(len(valid))]
            iou = np.array([sequence_iou(counts, assign(pair_iou(counts))) for counts in each])
        else:
            iou = sequence_iou(measured.all_counts, pairs)
        pixels = (REFERENCE_AREA / (self.target.width * self.target.height)) ** 0.5
        scale = pixels * float(self.schedule.pair_scale.mean())
        epe_frame = measured.epe_frame * scale
        reward = np.where(valid, iou - epe_frame, INVALID_REWARD)
        return Rewards(reward, iou, epe_frame, measured.epe * scale, valid)
