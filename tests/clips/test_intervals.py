"""Confidence intervals of means and shares."""

import numpy as np
import pytest

from pipeline.clips import intervals
from pipeline.clips.intervals import (
    MeanInterval,
    bootstrap_mean,
    bootstrap_ratio,
    bootstrap_ratio_difference,
    wilson,
)


def test_an_interval_holds_the_mean_and_covers_the_true_mean_in_about_95_of_100(rng: np.random.Generator) -> None:
    hits = 0
    for _ in range(200):
        e = bootstrap_mean(rng.normal(3.0, 1.0, 40), 400)
        assert e.low <= e.mean <= e.high
        hits += e.low <= 3.0 <= e.high
    assert hits >= 168  # at a coverage of 0.93, fewer come less than once in a million runs


def test_the_bootstrap_is_the_percentile_of_the_means_of_resamples() -> None:
    values, resamples = np.random.default_rng(1).random(12), 500
    means = np.random.default_rng(2).choice(values, (resamples, 12)).mean(1)
    e = bootstrap_mean(values, resamples, 2)
    assert (e.low, e.high) == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])))


def test_the_bootstrap_is_the_same_in_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(1).random(12)
    whole = bootstrap_mean(values, 500, 2)
    monkeypatch.setattr(intervals, "BATCH_NUMBERS", 100)
    assert bootstrap_mean(values, 500, 2) == whole


def test_values_that_are_missing_do_not_count() -> None:
    assert bootstrap_mean(np.array([np.nan, 1.0, np.nan]), 10) == MeanInterval(1.0, 1.0, 1.0, 1)
    assert bootstrap_mean(np.full(3, np.nan), 10).n == 0


def test_an_interval_is_read_from_the_row_that_it_makes() -> None:
    e = MeanInterval(0.5, 0.4, 0.6, 7)
    assert MeanInterval.of_row({k: str(v) for k, v in e.row().items()}) == e


@pytest.mark.parametrize(("hits", "count"), [(0, 5), (3, 7), (9, 9), (95, 100)])
def test_the_ends_of_wilsons_interval_are_1_96_standard_errors_from_the_share(hits: int, count: int) -> None:
    for end in wilson(hits, count):
        if 0 < end < 1:
            assert abs(hits / count - end) == pytest.approx(1.959964 * np.sqrt(end * (1 - end) / count), rel=1e-5)
    assert wilson(0, 0) == (0.0, 1.0)


def test_a_pooled_ratio_of_equal_wholes_is_a_mean() -> None:
    part = np.random.default_rng(1).random(12)
    e, of_means = bootstrap_ratio(part, np.ones(12), 4000, 2), bootstrap_mean(part, 4000, 3)
    assert e.mean == pytest.approx(of_means.mean) and e.n == 12
    assert (e.low, e.high) == pytest.approx((of_means.low, of_means.high), abs=0.02)


def test_a_pooled_ratio_weighs_clips_by_their_wholes_and_resamples_whole_clips() -> None:
    part, whole = np.array([0.0, 9.0]), np.array([1.0, 9.0])
    e = bootstrap_ratio(part, whole, 500)
    assert (e.mean, e.low, e.high) == (0.9, 0, 1)  # a resample has the first clip twice, both, or the second twice


def test_clips_without_a_ratio_are_left_out_of_the_pooled_one(monkeypatch: pytest.MonkeyPatch) -> None:
    part, whole = np.array([1.0, np.nan, 0.0, 2.0]), np.array([2.0, np.nan, 0.0, 4.0])
    e = bootstrap_ratio(part, whole, 300)
    assert e == MeanInterval(0.5, 0.5, 0.5, 3)
    assert bootstrap_ratio(np.full(3, np.nan), np.full(3, np.nan), 10).n == 0
    assert bootstrap_ratio(np.zeros(3), np.zeros(3), 10).n == 0
    rng = np.random.default_rng(3)
    part, whole = rng.integers(5, size=9).astype(float), rng.integers(5, 9, size=9).astype(float)
    at_once = bootstrap_ratio(part, whole, 500, 2)
    monkeypatch.setattr(intervals, "BATCH_NUMBERS", 100)
    assert bootstrap_ratio(part, whole, 500, 2) == at_once


def test_the_difference_of_ratios_is_taken_of_the_same_resamples() -> None:
    rng = np.random.default_rng(3)
    part, whole = rng.integers(0, 5, 60).astype(float), np.full(60, 5.0)
    better = np.minimum(part + 1, 5.0)
    e = bootstrap_ratio_difference((better, whole), (part, whole), 2000)
    assert e.mean == pytest.approx((better.sum() - part.sum()) / whole.sum())
    assert e.high - e.low < 0.5 * (bootstrap_ratio(part, whole, 2000).high - bootstrap_ratio(part, whole, 2000).low)
    assert bootstrap_ratio_difference((part, np.zeros(60)), (part, whole), 10).n == 0


def test_clips_that_lack_one_ratio_do_not_count_in_the_difference() -> None:
    part, whole = np.array([1.0, np.nan, 2.0]), np.array([2.0, 2.0, 4.0])
    e = bootstrap_ratio_difference((part, whole), (np.array([1.0, 1.0, 1.0]), whole), 50)
    assert e.n == 2 and e.mean == pytest.approx(3 / 6 - 2 / 6)
