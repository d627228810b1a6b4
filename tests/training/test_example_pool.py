"""The pool of clips that the tiny model is trained on."""

from multiprocessing import Queue

import numpy as np

from pipeline.language.codec import Tokens
from training.example_pool import BATCHES, Pool
from training.examples import Example
from training.patch_labels import PatchLabels


def example(length: int) -> Example:
    tokens = Tokens(np.zeros(length, np.int32), 1, np.zeros(length, bool), np.zeros(length, bool))
    nothing = np.zeros(0)
    return Example(tokens, nothing, PatchLabels(nothing, nothing, nothing))


def test_batches_hold_clips_of_like_length_and_all_clips_come(rng: np.random.Generator) -> None:
    lengths = rng.permutation(np.arange(200, 400))
    pool = Pool(200, 4.0, Queue(), [example(int(n)) for n in lengths])
    seen: set[int] = set()
    spans = []
    for _ in range(20 * BATCHES):
        batch = [len(e.tokens.ids) for e in pool.draw(rng, 8)]
        assert len(batch) == 8
        seen |= set(batch)
        spans.append(max(batch) - min(batch))
    assert len(seen) > 190 and np.mean(spans) < 60
    assert pool.drawn == 20 * BATCHES * 8
