"""Batches of training pairs, made by generator processes while the trainer computes."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.vision.render_backend import choose_backend
from training.augment import augment
from training.flow_pairs import Pair, sample_pair, sample_window

RENDER_SIZE = (240, 160)  # px, width and height of the whole picture
REUSE = 2
POOL_LEAST, POOL_MOST = 32, 500  # pairs


@dataclass(frozen=True)
class Phase:
    """From `start`, a share of the training, on: windows of `size` (width, height) px, `batch` to a step, and
    `iterations` of the recurrence."""

    start: float
    size: tuple[int, int]
    batch: int
    iterations: int


@dataclass(frozen=True)
class Batch:
    """frames_a, frames_b: (B, H, W, 3) uint8. flow_px: (B, H, W, 2) float32. foreground: (B, H, W) bool."""

    frames_a: np.ndarray
    frames_b: np.ndarray
    flow_px: np.ndarray
    foreground: np.ndarray


def stack(pairs: list[Pair]) -> Batch:
    return Batch(
        np.stack([p.frame_a for p in pairs]),
        np.stack([p.frame_b for p in pairs]),
        np.stack([p.flow_px for p in pairs]),
        np.stack([p.foreground for p in pairs]),
    )


class Pool:
    """Rendered pairs that are shown `REUSE` times on average, each time augmented anew: rendering is what costs."""

    def __init__(self, phase: Phase, mujoco_share: float) -> None:
        self.phase = phase
        self.mujoco_share = mujoco_share
        self.pairs: list[Pair] = []

    def draw(self, rng: np.random.Generator) -> Pair:
        if len(self.pairs) >= POOL_LEAST and rng.random() > 1 / REUSE:
            return self.pairs[rng.integers(len(self.pairs))]
        if self.phase.size == RENDER_SIZE:
            pair = sample_pair(rng, *RENDER_SIZE, self.mujoco_share)
        else:
            pair = sample_window(rng, *self.phase.size, RENDER_SIZE[1], self.mujoco_share)
        if len(self.pairs) < POOL_MOST:
            self.pairs.append(pair)
        else:
            self.pairs[rng.integers(POOL_MOST)] = pair
        return pair

    def batch(self, rng: np.random.Generator) -> Batch:
        return stack([augment(rng, self.draw(rng)) for _ in range(self.phase.batch)])


def phase_at(phases: tuple[Phase, ...], progress: float) -> Phase:
    return [p for p in phases if p.start <= progress][-1]


def generate(seed: tuple[int, ...], phases: tuple[Phase, ...], mujoco_share: float, progress, batches) -> None:
    """A generator process: fills `batches` until the trainer is gone."""
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the trainer ends it
    batches.cancel_join_thread()  # a trainer that was killed reads no more
    parent = os.getppid()
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    if mujoco_share > 0 and choose_backend("auto")[0] != "mujoco":
        mujoco_share = 0.0
    pool = Pool(phases[0], mujoco_share)
    while True:
        phase = phase_at(phases, progress.value)
        if phase is not pool.phase:
            pool = Pool(phase, mujoco_share)
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

    def __init__(self, seed: int, start: int, phases: tuple[Phase, ...], workers: int, mujoco_share: float) -> None:
        context = multiprocessing.get_context("spawn")
        self._progress = context.Value("d", 0.0)
        self._batches = context.Queue(maxsize=max(8, 3 * workers))
        self._processes = [
            context.Process(
                target=generate,
                args=((seed, start, k), phases, mujoco_share, self._progress, self._batches),
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
