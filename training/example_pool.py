"""The latest training clips, in memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from torch import multiprocessing

from training.examples import Example

BATCHES = 8  # drawn together, and sorted by length


@dataclass
class Pool:
    """The latest clips, from which batches are drawn: `reuse` draws a clip on average. waiting: batches drawn already;
    clips of a batch are about as long as each other, since all are padded to the longest."""

    capacity: int
    reuse: float
    source: multiprocessing.Queue
    examples: list[Example]
    drawn: int = 0
    received: int = 0
    last_chunk: int = -1
    waiting: list[list[Example]] = field(default_factory=list)

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

    def draw(self, rng: np.random.Generator, count: int) -> list[Example]:
        self.drawn += count
        if not self.waiting:
            drawn = [self.examples[i] for i in rng.integers(len(self.examples), size=BATCHES * count)]
            drawn.sort(key=lambda e: len(e.tokens.ids))
            self.waiting = [drawn[i * count : (i + 1) * count] for i in rng.permutation(BATCHES)]
        return self.waiting.pop()
