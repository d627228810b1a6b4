"""Batches of training pairs, made by worker processes while the trainer computes."""

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
from training.body_motion import sample_body_motion
from training.clip_motions import ClipMotions
from training.frame_pair import FramePair
from training.raft.rendered_pairs import render_pair, sample_pair_appearance, window_pair
from training.raft.warped_pairs import warped_pair

RENDER_SIZE = (240, 160)  # px, width and height of the whole picture
REUSE = 2  # times that a rendered pair is drawn on average
COLD = 0.5  # share of pairs that start from zero flow, where others start from DIS's
RANDOM_BODIES = 0.25  # share of pairs with random bodies; the others are from simulated clips
POOL_MIN, POOL_MAX = 32, 500  # pairs


@dataclass(frozen=True)
class Phase:
    """A phase of the training.

    Attributes:
        start: Share of the training at which it starts.
        size: Width and height of the windows, px.
        batch: Pairs a step.
        iterations: Recurrent updates.
        warped: Share of warped textures among the pairs.
    """

    start: float
    size: tuple[int, int]
    batch: int
    iterations: int
    warped: float = 0.0


@dataclass(frozen=True)
class Batch:
    """B pairs.

    Attributes:
        frames_a: (B, H, W, 3) uint8.
        frames_b: (B, H, W, 3) uint8.
        flow_px: (B, H, W, 2) float32.
        foreground: (B, H, W) bool.
        start_px: (B, H, W, 2) float32, the flow that the network refines; None for zero flow.
    """

    frames_a: np.ndarray
    frames_b: np.ndarray
    flow_px: np.ndarray
    foreground: np.ndarray
    start_px: np.ndarray | None = None


def stack(pairs: list[FramePair]) -> Batch:
    return Batch(
        np.stack([p.frame_a for p in pairs]),
        np.stack([p.frame_b for p in pairs]),
        np.stack([p.flow_px for p in pairs]),
        np.stack([p.foreground for p in pairs]),
    )


def with_warm_start(rng: np.random.Generator, batch: Batch, preset: str) -> Batch:
    """The batch with DIS's flow to refine; a share `COLD` of the pairs starts from zero flow."""
    start = DIS(preset).flow(batch.frames_a, batch.frames_b)
    start[rng.random(len(start)) < COLD] = 0
    return replace(batch, start_px=start)


class Pool:
    """Rendered pairs, each drawn `REUSE` times on average, since rendering is slow, and augmented anew each time."""

    def __init__(
        self, phase: Phase, clips: ClipMotions, mujoco_share: float = 0.0, warm_start: str | None = None
    ) -> None:
        self.phase = phase
        self.clips = clips
        self.warm_start = warm_start
        self.mujoco_share = mujoco_share
        self.pairs: list[FramePair] = []

    def draw(self, rng: np.random.Generator) -> FramePair:
        if rng.random() < self.phase.warped:
            return warped_pair(rng, *self.phase.size)
        if len(self.pairs) >= POOL_MIN and rng.random() > 1 / REUSE:
            return self.pairs[rng.integers(len(self.pairs))]
        motion = sample_body_motion(rng) if rng.random() < RANDOM_BODIES else self.clips.draw(rng)
        mujoco = bool(rng.random() < self.mujoco_share)
        if self.phase.size == RENDER_SIZE:
            pair = render_pair(rng, motion, sample_pair_appearance(rng, len(motion.objects)), *RENDER_SIZE, mujoco)
        else:
            pair = window_pair(rng, motion, *self.phase.size, RENDER_SIZE[1], mujoco)
        if len(self.pairs) < POOL_MAX:
            self.pairs.append(pair)
        else:
            self.pairs[rng.integers(POOL_MAX)] = pair
        return pair

    def batch(self, rng: np.random.Generator) -> Batch:
        batch = stack([augment(rng, self.draw(rng)) for _ in range(self.phase.batch)])
        return batch if self.warm_start is None else with_warm_start(rng, batch, self.warm_start)


def phase_at(phases: tuple[Phase, ...], progress: float) -> Phase:
    return [p for p in phases if p.start <= progress][-1]


def generate(
    seed: tuple[int, ...], phases: tuple[Phase, ...], mujoco_share: float, warm_start: str | None, progress, batches
) -> None:
    """A worker process: fills the queue `batches` until the trainer ends.

    Args:
        seed: Of this process.
        phases: Of the training.
        mujoco_share: Share of the pairs that MuJoCo renders, where it can.
        warm_start: DIS preset whose flow is refined, or None.
        progress: Shared value, the share of the training that is over.
        batches: Queue of batches.
    """
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
    """An endless iterator of batches from `workers` spawned processes; `advance` moves it on to later phases."""

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
                    raise RuntimeError("every worker process has died; see their errors above") from None

    def close(self) -> None:
        for process in self._processes:
            process.terminate()
            process.join(timeout=5)
