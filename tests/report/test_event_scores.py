"""Scores of said and simulated events on answers whose scores are known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.clips.events import DEFAULT_THRESHOLDS, Event
from pipeline.clips.matched_events import EventCounts, with_objects
from pipeline.clips.schedule import Schedule
from pipeline.model.language.completion import write_completion
from pipeline.report.event_scores import (
    CONSISTENCY,
    EVENT_METRICS,
    KIND_METRICS,
    SAID,
    SIMULATED,
    compare_events,
    event_columns,
    read_said_events,
    score_events,
    simulated_events,
)
from pipeline.report.event_table import COMPARED, EVENTS, HEADER, events_table
from pipeline.report.scene_scores import score_with_pairs, true_reference
from pipeline.report.suite import AnsweredSuite
from pipeline.report.summary import COUNTS, Summary, as_csv, as_json, summarise, with_metrics
from pipeline.report.tables import metrics_table
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.text import write_scene

CAMERA = Camera((0.0, -2.0, 0.8), fov=42.0, pitch=-20.0)
BALL = SceneObject("sphere", (0.1,), 1.0, position=(-0.4, 0.2, 0.3))
SLIDER = SceneObject("box", (0.2, 0.25, 0.1), 1.0, 0.4, position=(0.3, 0.1, 0.05), velocity=(0.8, 0.0, 0.0))
SCENE = Scene((BALL, SLIDER), CAMERA)
SCHEDULE = Schedule()
TRUE = simulated_events(SCENE, SCHEDULE, DEFAULT_THRESHOLDS)


def f1_of(scene: Scene, said: list[Event] | None) -> dict[str, float]:
    """The three F1 scores of an answer, by metric; of those alone that it has."""
    text = write_completion(scene, said, SCHEDULE.seconds)
    pairs = score_with_pairs(scene, true_reference(SCENE, SCHEDULE), SCHEDULE).pairs
    columns = score_events(scene, pairs, text, TRUE, SCHEDULE, DEFAULT_THRESHOLDS)
    return {
        m: EventCounts(*(columns[f"{m}.{count}"] for count in COUNTS)).f1
        for m in EVENT_METRICS
        if f"{m}.true" in columns
    }


def test_the_clip_of_these_tests_has_events_of_both_bodies() -> None:
    assert {(e.kind, e.first) for e in TRUE} >= {("hits_ground", 0), ("stops_sliding", 1)}


def test_a_perfect_answer_has_full_marks_whatever_the_order_of_its_objects() -> None:
    perfect = dict.fromkeys(EVENT_METRICS, 1.0)
    assert f1_of(SCENE, TRUE) == perfect
    assert f1_of(Scene((SLIDER, BALL), CAMERA), with_objects(TRUE, [1, 0])) == perfect


def test_words_that_are_wrong_of_a_scene_that_is_right_are_neither_true_nor_consistent() -> None:
    late = [replace(e, time=e.time + 0.2) for e in TRUE]
    assert f1_of(SCENE, late) == {SAID: 0, SIMULATED: 1, CONSISTENCY: 0}
    assert f1_of(SCENE, []) == {SAID: 0, SIMULATED: 1, CONSISTENCY: 0}


def test_words_that_describe_a_wrong_scene_rightly_are_consistent_and_not_true() -> None:
    resting = Scene((replace(BALL, position=(-0.4, 0.2, 0.1)), replace(SLIDER, velocity=(3.0, 0.0, 0.0))), CAMERA)
    own = simulated_events(resting, SCHEDULE, DEFAULT_THRESHOLDS)
    assert own and own != TRUE
    got = f1_of(resting, own)
    assert got[CONSISTENCY] == 1 and got[SAID] == got[SIMULATED] < 1


def test_without_reasoning_nothing_is_said_and_that_is_no_0() -> None:
    assert f1_of(SCENE, None) == {SIMULATED: 1}
    assert read_said_events(write_completion(SCENE, None, 1.0)) is None
    assert read_said_events(write_completion(SCENE, [], 1.0)) == []
    assert set(compare_events(None, TRUE, TRUE, [0, 1])) == {SIMULATED}


def test_an_answer_that_cannot_be_simulated_has_no_events() -> None:
    assert (
        simulated_events(Scene((replace(BALL, velocity=(1e30, 0.0, 0.0)),), CAMERA), SCHEDULE, DEFAULT_THRESHOLDS) == []
    )


def test_an_object_too_many_adds_events_that_are_not_true() -> None:
    more = Scene((*SCENE.objects, replace(BALL, position=(0.0, 0.6, 0.3))), CAMERA)
    columns = score_events(more, np.array([[0, 0], [1, 1]]), None, TRUE, SCHEDULE, DEFAULT_THRESHOLDS)
    counts = EventCounts(*(columns[f"{SIMULATED}.{count}"] for count in COUNTS))
    assert counts.recall == 1 and counts.precision < 1


# ---- sums over clips


def rows_of(*clips: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    head = {"suite": "id", "method": "greedy", "simulations": 0, "seconds": 0.0, "iou": 0.5}
    return [{**head, **event_columns(counts)} for counts in clips]


def summary_of(*clips: dict[str, dict[str, Any]]) -> Summary:
    return summarise(rows_of(*clips), ["iou"], 200, f1_metrics=[*EVENT_METRICS, *KIND_METRICS])


def test_f1_is_that_of_the_counts_of_all_clips_and_not_the_mean_of_their_f1() -> None:
    few = compare_events(TRUE[:1], TRUE[:1], TRUE[:1], [0, 1])
    many = [Event(k / 10, "enters", 0) for k in range(9)]
    none_right = compare_events([], many, many, [0, 1])
    found = summary_of(few, none_right)
    f1 = found.intervals["id", "greedy"][SAID]
    assert f1.mean == pytest.approx(2 / 11) and f1.n == 2 and f1.low <= f1.mean <= f1.high
    assert found.counts["id", "greedy"][SAID] == (1, 1, 10)
    assert found.intervals["id", "greedy"][f"{SAID}.enters"].mean == 0
    assert found.intervals["id", "greedy"][CONSISTENCY].mean == f1.mean


def test_a_column_without_events_is_empty_in_every_form() -> None:
    found = with_metrics(summary_of(compare_events(None, TRUE, TRUE, [0, 1])), ["iou", *EVENT_METRICS])
    assert metrics_table(found, EVENTS)[1][0][-3:] == ["–", "1 (1–1)", "–"]
    assert SAID not in as_json(found)["id"]["greedy"] and as_json(found)["id"]["greedy"][SIMULATED] == 1
    assert SAID not in as_csv(found) and SIMULATED in as_csv(found) and "hits_ground" not in as_csv(found)


def test_every_comparison_has_a_heading() -> None:
    assert tuple(EVENTS) == tuple(COMPARED) == EVENT_METRICS


def test_the_table_has_the_counts_and_shares_of_each_kind_that_occurs() -> None:
    true = [Event(0.1, "hits_ground", 0), Event(0.5, "hits_ground", 0), Event(0.9, "leaves", 0)]
    said = [Event(0.1, "hits_ground", 0), Event(0.2, "enters", 0)]
    header, rows = events_table(summary_of(compare_events(said, true, true, [0])))
    assert header == HEADER
    of_said = [row[3:] for row in rows if row[2] == COMPARED[SAID]]
    assert [row[:6] for row in of_said] == [
        ["all", "2", "3", "1", "0.5", "0.333"],
        ["hits ground", "1", "2", "1", "1", "0.5"],
        ["enters", "1", "0", "0", "0", "–"],
        ["leaves", "0", "1", "0", "–", "0"],
    ]
    assert of_said[0][6] == "0.4 (0.4–0.4)"
    assert [row[3] for row in rows if row[2] == COMPARED[SIMULATED]] == ["all", "hits ground", "leaves"]


# ---- a suite of shards


class FakeClip:
    """A clip whose tables are given."""

    def __init__(self, **tables: list[dict[str, Any]]) -> None:
        self._tables = tables

    def rows(self, table: str = "clips") -> list[dict[str, Any]]:
        return self._tables[table]

    def row(self, table: str = "clips") -> dict[str, Any]:
        (row,) = self._tables[table]
        return row

    def array(self, name: str) -> np.ndarray:
        return self._tables[name][0]["array"]


class FakeStage(list[FakeClip]):
    """The clips of a stage."""

    def compute_seconds(self) -> float:
        return 1.0


def suite_of(reasoning: bool, with_events: bool) -> AnsweredSuite:
    """One clip. The greedy answer is true but says nothing happens; the best of two samples, the second, is perfect."""
    scene, texts = write_scene(SCENE), [[], [Event(0.9, "enters", 0)], TRUE]
    infer = [
        {"sample": k - 1, "scene": scene, "text": write_completion(SCENE, e if reasoning else None, 1.0)}
        for k, e in enumerate(texts)
    ]
    found = {"scene": scene, "simulations": 3, "guess": None}
    events = [{"time": e.time, "kind": e.kind, "first": e.first, "second": -1} for e in TRUE]
    stages = {
        "sample": FakeClip(clips=[{"scene": scene}]),
        "infer": FakeClip(clips=infer),
        "best_of_k": FakeClip(clips=[{"sample": 1, "scene": scene}, {"sample": 0, "scene": scene}]),
        "cmaes": FakeClip(clips=[found]),
        "fit": FakeClip(clips=[found]),
        **({"events": FakeClip(events=events)} if with_events else {}),
    }
    return AnsweredSuite("id", {name: FakeStage([clip]) for name, clip in stages.items()})  # type: ignore[misc]


def f1_by_method(suite: AnsweredSuite) -> dict[tuple[str, str], float | None]:
    rows = list(suite.score_rows(SCHEDULE, DEFAULT_THRESHOLDS))
    assert {row["iou"] for row in rows} == {1.0}
    return {
        (row["method"], m): EventCounts(*(row[f"{m}.{count}"] for count in COUNTS)).f1 if f"{m}.true" in row else None
        for row in rows
        for m in EVENT_METRICS
    }


def test_methods_without_words_have_events_of_their_simulation_alone() -> None:
    found = f1_by_method(suite_of(reasoning=True, with_events=True))
    methods = ("greedy", "best@2", "cmaes", "search")
    assert [found[m, SIMULATED] for m in methods] == [1, 1, 1, 1]
    assert [found[m, SAID] for m in methods] == [found[m, CONSISTENCY] for m in methods] == [0, 1, None, None]


def test_a_suite_whose_events_are_not_known_and_a_model_without_reasoning_have_empty_columns() -> None:
    assert set(f1_by_method(suite_of(reasoning=True, with_events=False)).values()) == {None}
    silent = f1_by_method(suite_of(reasoning=False, with_events=True))
    assert silent["greedy", SAID] is silent["best@2", CONSISTENCY] is None
    assert silent["greedy", SIMULATED] == 1
