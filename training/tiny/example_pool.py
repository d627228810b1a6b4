"""The latest training clips in memory, from which batches are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from torch import multiprocessing

from pipeline.language.completion import MAX_OBJECTS
from training.tiny.examples import Example
from training.tiny.patch_labels import PatchLabels

MEASURED_REUSE = 10  # draws of each temporal patch, or of each clip, before the model memorises it
BATCHES = 8  # drawn together, and sorted by length


@dataclass
class Pool:
    """The latest clips.

    Attributes:
        capacity: Clips in memory; then a new clip replaces the oldest.
        reuse: Draws of a clip on average.
        source: Queue of (chunk, examples).
        examples: The clips.
        drawn: Draws of `examples` so far.
        received: Clips received so far.
        last_chunk: Largest number of a chunk received.
        waiting: Batches drawn already. Clips of a batch have similar lengths, since all are padded to the longest.
        measured: Clips with RAFT's own flow, which are expensive.
        measured_share: Share of the draws from `measured`, until each of these was drawn `MEASURED_REUSE` times.
        drawn_measured: Draws of `measured` so far.
        max_objects: Largest number of objects of a clip that is drawn.
    """

    capacity: int
    reuse: float
    source: multiprocessing.Queue
    examples: list[Example]
    drawn: float = 0.0
    received: int = 0
    last_chunk: int = -1
    waiting: list[list[Example]] = field(default_factory=list)
    measured: list[Example] = field(default_factory=list)
    measured_share: float = 0.0
    drawn_measured: float = 0.0
    max_objects: int = MAX_OBJECTS

    def fill(self, at_least: int) -> None:
        """Receive examples until there are `at_least`, and as many as `reuse` asks for."""
        while len(self.examples) < at_least or self.drawn > self.reuse * self.received:
            chunk, examples = self.source.get(timeout=600)
            self.last_chunk = max(self.last_chunk, chunk)
            for example in examples:
                if len(self.examples) < self.capacity:
                    self.examples.append(example)
                else:
                    self.examples[self.received % self.capacity] = example
                self.received += 1

    def chosen(self, rng: np.random.Generator, count: int, weight: float = 1.0) -> list[Example]:
        """`count` examples, drawn with replacement. weight: share of each that is used."""
        left = MEASURED_REUSE * len(self.measured) - self.drawn_measured
        from_measured = rng.random(count) < (self.measured_share if left > 0 else 0.0)
        self.drawn_measured += weight * float(from_measured.sum())
        self.drawn += weight * float(count - from_measured.sum())
        return [self.one(rng, self.measured if measured else self.examples) for measured in from_measured]

    def one(self, rng: np.random.Generator, examples: Sequence[Example]) -> Example:
        """One with at most `max_objects` objects; after 100 draws in vain, any one."""
        for _ in range(100):
            example = examples[int(rng.integers(len(examples)))]
            if example.objects <= self.max_objects:
                break
        return example

    def mosaics(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, list[PatchLabels]]:
        """Pictures (count, T, H, W, 3) and labels of mosaics: each temporal patch is from another clip.

        The vision tower sees temporal patches one by one, and learns twice as much from those of different clips.
        """
        slices = len(self.examples[0].patches.shape)
        chosen = [self.chosen(rng, slices, 1 / slices) for _ in range(count)]
        return np.stack([mosaic([e.picture for e in row]) for row in chosen]), [
            PatchLabels(*(mosaic([getattr(e.patches, f.name) for e in row]) for f in fields(PatchLabels)))
            for row in chosen
        ]

    def draw(self, rng: np.random.Generator, count: int) -> list[Example]:
        """A batch of clips of similar length."""
        if not self.waiting:
            drawn = self.chosen(rng, BATCHES * count)
            drawn.sort(key=lambda e: len(e.tokens.ids))
            self.waiting = [drawn[i * count : (i + 1) * count] for i in rng.permutation(BATCHES)]
        return self.waiting.pop()


def mosaic(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Array k of n gives part k of n, in time, of the result (T, ...)."""
    length = len(parts[0]) // len(parts)
    return np.concatenate([part[k * length : (k + 1) * length] for k, part in enumerate(parts)])
