"""The latest training clips, in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from torch import multiprocessing

from pipeline.language.completion import MAX_OBJECTS
from training.examples import Example
from training.patch_labels import PatchLabels

KEPT_REUSE = 10  # draws of each temporal patch, or of each clip, beyond which it is learned by heart
BATCHES = 8  # drawn together, and sorted by length


@dataclass
class Pool:
    """The latest clips, from which batches are drawn: `reuse` draws a clip on average. Of the clips drawn a `share`
    comes from `kept`, which are costly, until they were drawn `KEPT_REUSE` times each. most: objects of a clip that is
    drawn. waiting: batches drawn already; clips of a batch are about as long as each other, since all are padded to the
    longest."""

    capacity: int
    reuse: float
    source: multiprocessing.Queue
    examples: list[Example]
    drawn: float = 0.0
    received: int = 0
    last_chunk: int = -1
    waiting: list[list[Example]] = field(default_factory=list)
    kept: list[Example] = field(default_factory=list)
    share: float = 0.0
    drawn_kept: float = 0.0
    most: int = MAX_OBJECTS

    def fill(self, least: int) -> None:
        """Take new examples until there are `least`, and as many as `reuse` asks for; the makers rest otherwise."""
        while len(self.examples) < least or self.drawn > self.reuse * self.received:
            chunk, examples = self.source.get(timeout=600)
            self.last_chunk = max(self.last_chunk, chunk)
            for example in examples:
                if len(self.examples) < self.capacity:
                    self.examples.append(example)
                else:
                    self.examples[self.received % self.capacity] = example
                self.received += 1

    def chosen(self, rng: np.random.Generator, count: int, weight: float = 1.0) -> list[Example]:
        """So many examples, drawn with replacement. weight: share of each that is used."""
        left = KEPT_REUSE * len(self.kept) - self.drawn_kept
        from_kept = rng.random(count) < (self.share if left > 0 else 0.0)
        self.drawn_kept += weight * float(from_kept.sum())
        self.drawn += weight * float(count - from_kept.sum())
        return [self.one(rng, self.kept if kept else self.examples) for kept in from_kept]

    def one(self, rng: np.random.Generator, examples: Sequence[Example]) -> Example:
        """One of them with `most` objects; any one where chance finds none."""
        for _ in range(100):
            example = examples[int(rng.integers(len(examples)))]
            if example.objects <= self.most:
                break
        return example

    def mosaics(self, rng: np.random.Generator, count: int) -> tuple[np.ndarray, list[PatchLabels]]:
        """Pictures (count, T, H, W, 3) and labels of clips each of whose temporal patches is from another clip: the
        vision tower looks at them one by one, and learns twice as much from those of different clips."""
        slices = len(self.examples[0].patches.shape)
        chosen = [self.chosen(rng, slices, 1 / slices) for _ in range(count)]
        return np.stack([mosaic([e.picture for e in row]) for row in chosen]), [
            PatchLabels(*(mosaic([getattr(e.patches, f.name) for e in row]) for f in fields(PatchLabels)))
            for row in chosen
        ]

    def draw(self, rng: np.random.Generator, count: int) -> list[Example]:
        if not self.waiting:
            drawn = self.chosen(rng, BATCHES * count)
            drawn.sort(key=lambda e: len(e.tokens.ids))
            self.waiting = [drawn[i * count : (i + 1) * count] for i in rng.permutation(BATCHES)]
        return self.waiting.pop()


def mosaic(parts: Sequence[np.ndarray]) -> np.ndarray:
    """The k-th of n equal parts in time from the k-th of n arrays (T, ...)."""
    length = len(parts[0]) // len(parts)
    return np.concatenate([part[k * length : (k + 1) * length] for k, part in enumerate(parts)])
