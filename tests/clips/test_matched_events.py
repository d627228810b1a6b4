"""Precision, recall and F1 of events whose scores are known."""

from collections.abc import Sequence
from dataclasses import astuple, fields, replace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from pipeline.clips.events import KINDS, Event
from pipeline.clips.matched_events import (
    ANSWERED_KINDS,
    TOLERANCE_S,
    EventCounts,
    count_by_kind,
    match_events,
    true_numbers,
    with_objects,
)
from pipeline.report.summary import COUNTS

TRUE = [
    Event(0.1, "hits_ground", 0),
    Event(0.2, "starts_rolling", 0),
    Event(0.3, "hits_object", 0, 1),
    Event(0.32, "starts_sliding", 1),
    Event(0.5, "hits_object", 1, 2),
    Event(0.7, "stops_sliding", 1),
    Event(0.8, "stops_rolling", 0),
    Event(0.9, "enters", 3),
    Event(0.95, "leaves", 0),
]


def later(events: list[Event], seconds: float) -> list[Event]:
    return [replace(e, time=e.time + seconds) for e in events]


def drawn(rng: np.random.Generator, count: int) -> list[Event]:
    """Events so crowded that many have several possible partners."""
    return [
        Event(float(t), "hits_ground", int(i))
        for t, i in zip(rng.random(count), rng.integers(2, size=count), strict=True)
    ]


def largest_matching(found: list[Event], true: list[Event]) -> int:
    """The number of pairs by the Hungarian method."""
    fits = np.array(
        [[a.first == b.first and abs(a.time - b.time) <= TOLERANCE_S for b in true] for a in found], float
    ).reshape(len(found), len(true))
    return int(fits[linear_sum_assignment(-fits)].sum())


def count_events(found: Sequence[Event], true: Sequence[Event]) -> EventCounts:
    """The counts of all kinds together."""
    return sum(count_by_kind(found, true).values(), EventCounts())


def test_a_perfect_answer_has_an_f1_of_1_in_all_and_by_kind() -> None:
    counts = count_events(TRUE, TRUE)
    assert (counts.precision, counts.recall, counts.f1) == (1, 1, 1)
    assert {c.f1 for c in count_by_kind(TRUE, TRUE).values()} == {1}


@pytest.mark.parametrize(
    ("seconds", "f1"), [(0.09, 1), (-0.09, 1), (0.1, 1), (-0.1, 1), (0.11, 0), (0.2, 0), (-0.2, 0)]
)
def test_all_times_may_be_off_by_a_tenth_of_a_second_and_no_more(seconds: float, f1: float) -> None:
    assert count_events(later(TRUE, seconds), TRUE).f1 == f1


def test_who_hits_and_who_is_hit_makes_no_difference() -> None:
    swapped = [e if e.second is None else replace(e, first=e.second, second=e.first) for e in TRUE]
    assert swapped != TRUE and count_events(swapped, TRUE).f1 == 1


def test_another_kind_or_another_body_does_not_match() -> None:
    for change in ({"kind": "enters"}, {"first": 2}):
        assert count_events([replace(TRUE[0], **change)], [TRUE[0]]) == EventCounts(0, 1, 1)  # type: ignore[arg-type]
    assert count_events([Event(0.3, "hits_object", 0, 2)], [Event(0.3, "hits_object", 0, 1)]).matched == 0


def test_events_that_do_not_happen_lower_precision_alone_and_missing_ones_recall_alone() -> None:
    extra = [*TRUE, Event(0.6, "hits_ground", 2), Event(0.1, "hits_ground", 0), Event(0.1, "enters", 0)]
    counts = count_events(extra, TRUE)
    assert (counts.precision, counts.recall) == (9 / 12, 1)
    counts = count_events(TRUE[:6], TRUE)
    assert (counts.precision, counts.recall) == (1, 6 / 9)


def test_f1_is_the_harmonic_mean_of_precision_and_recall_and_does_not_change_with_the_roles() -> None:
    counts = count_events([*TRUE[:4], Event(0.6, "enters", 2)], TRUE)
    assert counts.f1 == pytest.approx(2 / (1 / counts.precision + 1 / counts.recall))
    assert count_events(TRUE, [*TRUE[:4], Event(0.6, "enters", 2)]).f1 == counts.f1


def test_a_true_event_matches_once() -> None:
    assert count_events([TRUE[0]] * 3, [TRUE[0]]) == EventCounts(1, 3, 1)


def test_the_matching_is_the_largest_one(rng: np.random.Generator) -> None:
    nearest_first = (
        [Event(0.3, "enters", 0), Event(0.39, "enters", 0)],
        [Event(0.21, "enters", 0), Event(0.31, "enters", 0)],
    )
    assert match_events(*nearest_first) == [(0, 0), (1, 1)]  # 0.30 with 0.31 would leave 0.39 without a partner
    for _ in range(200):
        found, true = drawn(rng, int(rng.integers(9))), drawn(rng, int(rng.integers(9)))
        pairs = match_events(found, true)
        assert len(pairs) == largest_matching(found, true)
        assert all(len(set(side)) == len(pairs) for side in zip(*pairs, strict=True))
        assert all(abs(found[i].time - true[j].time) <= TOLERANCE_S + 1e-9 for i, j in pairs)


def test_the_order_of_events_does_not_matter(rng: np.random.Generator) -> None:
    found, true = drawn(rng, 8), drawn(rng, 8)
    shuffled = [found[i] for i in rng.permutation(8)], [true[i] for i in rng.permutation(8)]
    assert count_events(*shuffled) == count_events(found, true)


def test_the_counts_of_kinds_add_up(rng: np.random.Generator) -> None:
    kinds = [replace(e, kind=str(rng.choice(("enters", "leaves", "hits_ground")))) for e in drawn(rng, 20)]
    by_kind = count_by_kind(kinds, TRUE)
    assert tuple(by_kind) == ANSWERED_KINDS == tuple(k for k in KINDS if k != "hits_fixed")
    assert sum(by_kind.values(), EventCounts()) == count_events(kinds, TRUE)
    assert count_events(kinds, TRUE).found == 20


def test_shares_of_nothing_are_not_numbers() -> None:
    nothing = EventCounts()
    assert all(np.isnan([nothing.precision, nothing.recall, nothing.f1]))
    silent = count_events([], TRUE)
    assert np.isnan(silent.precision) and (silent.recall, silent.f1) == (0, 0)


def test_the_counts_are_the_columns_of_the_rows_of_scores() -> None:
    assert tuple(f.name for f in fields(EventCounts)) == COUNTS
    assert astuple(EventCounts(1, 2, 3)) == (1, 2, 3)


def test_objects_are_compared_with_those_that_they_were_assigned_to(rng: np.random.Generator) -> None:
    order = rng.permutation(4)  # true object of each object of the answer
    pairs = np.stack([np.arange(4), order], 1)
    answered = with_objects(TRUE, np.argsort(order).tolist())
    assert count_events(with_objects(answered, true_numbers(pairs, 4)), TRUE).f1 == 1


def test_events_of_an_object_without_a_partner_match_none() -> None:
    numbers = true_numbers(np.array([[0, 0], [1, 1], [2, 2]]), 5)
    assert numbers[:3] == [0, 1, 2] and max(numbers[3:]) < 0 and len(set(numbers)) == 5
    moved = with_objects(
        [Event(0.3, "hits_object", 0, 3), Event(0.9, "enters", 3), Event(0.9, "hits_fixed", 3, 1)], numbers
    )
    assert moved[2].second == 1
    assert count_events(moved[:2], [Event(0.3, "hits_object", 0, 1), Event(0.9, "enters", 3)]).matched == 0
