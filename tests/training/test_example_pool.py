"""The pool of clips that the tiny model is trained on."""

from dataclasses import replace
from multiprocessing import Queue

import numpy as np
import pytest

from pipeline.language.codec import Tokens
from training.tiny.example_pool import BATCHES, MEASURED_REUSE, Pool
from training.tiny.examples import Example
from training.tiny.patch_labels import PatchLabels
from training.tiny.soft_numbers import SoftTargets

NO_TARGETS = SoftTargets(*(np.zeros(0, t) for t in (np.int64, np.int64, np.float32)))


def tokens(length: int) -> Tokens:
    return Tokens(np.zeros(length, np.int32), 1, np.zeros(length, bool), np.zeros(length, bool))


def numbered(value: int) -> Example:
    pair = np.arange(3)  # temporal patches of two pictures each
    labels = PatchLabels(*(10 * value + pair[:, None] for _ in range(3)))
    return Example(tokens(9), NO_TARGETS, (10 * value + pair.repeat(2))[:, None], labels)


def showing(objects: int) -> Example:
    place = np.arange(6).reshape(1, 2, 3) % objects
    return replace(numbered(0), patches=PatchLabels(np.ones_like(place), place, place))


def test_batches_hold_clips_of_like_length_and_all_clips_come(rng: np.random.Generator) -> None:
    lengths = rng.permutation(np.arange(200, 400))
    pool = Pool(200, 4.0, Queue(), [replace(numbered(0), tokens=tokens(int(n))) for n in lengths])
    seen: set[int] = set()
    spans = []
    for _ in range(20 * BATCHES):
        batch = [len(e.tokens.ids) for e in pool.draw(rng, 8)]
        assert len(batch) == 8
        seen |= set(batch)
        spans.append(max(batch) - min(batch))
    assert len(seen) > 190 and np.mean(spans) < 60
    assert pool.drawn == 20 * BATCHES * 8  # batches drawn together, the last all used


def test_a_mosaic_has_each_moment_of_another_clip_with_its_labels(rng: np.random.Generator) -> None:
    pool = Pool(50, 4.0, Queue(), [numbered(i) for i in range(50)], max_objects=1000)
    pictures, labels = pool.mosaics(rng, 40)
    assert pictures.shape == (40, 6, 1) and len(labels) == 40
    assert pool.drawn == pytest.approx(40)
    np.testing.assert_array_equal(pictures[:, :, 0] % 10, np.tile([0, 0, 1, 1, 2, 2], (40, 1)))
    for picture, own in zip(pictures, labels, strict=True):
        for values in (own.shape, own.place, own.numbers):
            np.testing.assert_array_equal(values, picture[::2])
    assert len(np.unique(pictures // 10)) > 25 and (np.ptp(pictures // 10, axis=1) > 0).mean() > 0.8


def test_a_share_of_the_draws_is_of_measured_clips_until_each_was_drawn_ten_times(rng: np.random.Generator) -> None:
    measured = [numbered(70 + i) for i in range(10)]
    examples = [numbered(i) for i in range(50)]
    pool = Pool(50, 4.0, Queue(), examples, measured=measured, measured_share=0.3, max_objects=1000)
    values = [int(e.picture[0, 0]) // 10 for e in pool.chosen(rng, 2000)]
    assert 0.25 < np.mean([v >= 70 for v in values]) < 0.35  # 4.9 standard errors
    assert set(values) == {*range(50), *range(70, 80)}
    assert pool.drawn + pool.drawn_measured == 2000
    while pool.drawn_measured < MEASURED_REUSE * len(measured):
        pool.chosen(rng, 100)
    assert all(e.picture[0, 0] < 500 for e in pool.chosen(rng, 50))


def test_clips_with_more_objects_than_asked_for_are_not_drawn(rng: np.random.Generator) -> None:
    pool = Pool(50, 4.0, Queue(), [showing(i % 4 + 1) for i in range(40)], max_objects=2)
    assert {e.objects for e in pool.chosen(rng, 300)} == {1, 2}
    pool.max_objects = 6
    assert {e.objects for e in pool.chosen(rng, 300)} == {1, 2, 3, 4}
