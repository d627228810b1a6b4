"""Batches of training pairs, made by generator processes while the trainer computes."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.vision.flow.dis import DIS
from pipeline.vision.rendering.render_backend import choose_backend
from training.augment import augment
from training.clip_motions import ClipMotions
from training.flow_pairs import Pair, render_pair, sample_looks, window_pair
from training.motion import sample_motion
from training.warped_pairs import warped_pair

RENDER_SIZE = (240, 160)  # px, width and height of the whole picture
REUSE = 2
COLD = 0.5
WILD = 0.25  # of the pairs; the others are of the project's own clips
POOL_LEAST, POOL_MOST = 32, 500  # pairs


@dataclass(frozen=True)
class Phase:
    """From `start`, a share of the training, on: windows of `size` (width, height) px, `batch` to a step,
    `iterations` of the recurrence, and a share `warped` of pairs in which everything moves."""

    start: float
    size: tuple[int, int]
    batch: int
    iterations: int
    warped: float = 0.0


@dataclass(frozen=True)
class Batch:
    """frames_a, frames_b: (B, H, W, 3) uint8. flow_px: (B, H, W, 2) float32. foreground: (B, H, W) bool.
    start_px: (B, H, W, 2) float32, the flow to begin from, or None."""

    frames_a: np.ndarray
    frames_b: np.ndarray
    flow_px: np.ndarray
    foreground: np.ndarray
    start_px: np.ndarray | None = None


def stack(pairs: list[Pair]) -> Batch:
    return Batch(
        np.stack([p.frame_a for p in pairs]),
        np.stack([p.frame_b for p in pairs]),
        np.stack([p.flow_px for p in pairs]),
        np.stack([p.foreground for p in pairs]),
    )


def with_warm_start(rng: np.random.Generator, batch: Batch, preset: str) -> Batch:
    """The batch with DIS's flow to begin from; a share of COLD pairs begins from none."""
    start = DIS(preset).flow(batch.frames_a, batch.frames_b)
    start[rng.random(len(start)) < COLD] = 0
    return replace(batch, start_px=start)


class Pool:
    """Rendered pairs that are shown `REUSE` times on average, each time augmented anew: rendering is what costs."""

    def __init__(
        self, phase: Phase, clips: ClipMotions, mujoco_share: float = 0.0, warm_start: str | None = None
    ) -> None:
        self.phase = phase
        self.clips = clips
        self.warm_start = warm_start
        self.mujoco_share = mujoco_share
        self.pairs: list[Pair] = []

    def draw(self, rng: np.random.Generator) -> Pair:
        if rng.random() < self.phase.warped:
            return warped_pair(rng, *self.phase.size)
        if len(self.pairs) >= POOL_LEAST and rng.random() > 1 / REUSE:
            return self.pairs[rng.integers(len(self.pairs))]
        motion = sample_motion(rng) if rng.random() < WILD else self.clips.draw(rng)
        mujoco = bool(rng.random() < self.mujoco_share)
        if self.phase.size == RENDER_SIZE:
            pair = render_pair(rng, motion, sample_looks(rng, len(motion.objects)), *RENDER_SIZE, mujoco)
        else:
            pair = window_pair(rng, motion, *self.phase.size, RENDER_SIZE[1], mujoco)
        if len(self.pairs) < POOL_MOST:
            self.pairs.append(pair)
        else:
            self.pairs[rng.integers(POOL_MOST)] = pair
        return pair

    def batch(self, rng: np.random.Generator) -> Batch:
        batch = stack([augment(rng, self.draw(rng)) for _ in range(self.phase.batch)])
        return batch if self.warm_start is None else with_warm_start(rng, batch, self.warm_start)


def phase_at(phases: tuple[Phase, ...], progress: float) -> Phase:
    return [p for p in phases if p.start <= progress][-1]


def generate(
    seed: tuple[int, ...], phases: tuple[Phase, ...], mujoco_share: float, warm_start: str | None, progress, batches
) -> None:
    """A generator process: fills `batches` until the trainer is gone."""
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the trainer ends it
    batches.cancel_join_thread()  # a trainer that was killed reads no more
    parent = os.getppid()
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    if mujoco_share > 0 and choose_backend("auto")[0] != "mujoco":
        mujoco_share = 0.0
    clips = ClipMotions(int(rng.integers(1 << 40)))
    pool = Pool(phases[0], clips, mujoco_share, warm_start)
    while True:
        phase = phase_at(phases, progress.value)
        if phase is not pool.phase:
            pool = Pool(phase, clips, mujoco_share, warm_start)
        batch = pool.batch(rng)
        while True:
            if os.getppid() != parent:
                return
            try:
                batches.put(batch, timeout=5)
                break
            except queue.Full:
                continue


class PairStream:
    """An endless iterator of batches from `workers` spawned processes. `progress`, 0 to 1, chooses the phase."""

    def __init__(
        self,
        seed: int,
        start: int,
        phases: tuple[Phase, ...],
        workers: int,
        mujoco_share: float,
        warm_start: str | None,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._progress = context.Value("d", 0.0)
        self._batches = context.Queue(maxsize=max(8, 3 * workers))
        self._processes = [
            context.Process(
                target=generate,
                args=((seed, start, k), phases, mujoco_share, warm_start, self._progress, self._batches),
                daemon=True,
            )
            for k in range(workers)
        ]
        for process in self._processes:
            process.start()

    def advance(self, progress: float) -> None:
        self._progress.value = progress

    def __iter__(self) -> Iterator[Batch]:
        while True:
            try:
                yield self._batches.get(timeout=60)
            except queue.Empty:
                if not any(p.is_alive() for p in self._processes):
                    raise RuntimeError("every generator of training pairs has died; see their errors above") from None

    def close(self) -> None:
        for process in self._processes:
            process.terminate()
            process.join(timeout=5)
