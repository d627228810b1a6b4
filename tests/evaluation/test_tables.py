"""Sums, intervals and the forms in which they are written."""

import csv
import io
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.evaluation.figures import bars, curves, jpeg, painted, tiled
from pipeline.evaluation.mean_curves import best_of_curve, mean_curve
from pipeline.evaluation.report import Section, folded, html_table, page
from pipeline.evaluation.tables import Summary, as_csv, as_json, from_csv, markdown, summarise, table
from pipeline.metrics.intervals import bootstrap_mean


@pytest.fixture
def summary(rng: np.random.Generator) -> Summary:
    rows = [{"suite": s, "method": m, "simulations": 8, "seconds": 0.5, "iou": float(rng.random()), "composition": 1.0}
            for s in ("id", "more") for m in ("greedy", "cmaes") for _ in range(5)]  # fmt: skip
    return summarise(rows, ["iou", "composition", "error.mass"], 200, rng)


def test_an_interval_holds_the_mean_and_covers_the_true_mean_in_about_95_of_100(rng: np.random.Generator) -> None:
    hits = 0
    for _ in range(200):
        e = bootstrap_mean(rng.normal(3.0, 1.0, 40), 400, rng)
        assert e.low <= e.mean <= e.high
        hits += e.low <= 3.0 <= e.high
    assert 170 <= hits <= 200


def test_a_metric_that_no_clip_has_rests_on_none(rng: np.random.Generator) -> None:
    assert bootstrap_mean(np.full(3, np.nan), 10, rng).n == 0


def test_the_best_of_k_curve_is_the_mean_over_all_subsets(rng: np.random.Generator) -> None:
    reward, score = rng.random(6), rng.random(6)
    expected = [
        np.mean([score[max(c, key=lambda i: reward[i])] for c in combinations(range(6), k)]) for k in range(1, 7)
    ]
    assert best_of_curve(reward, score) == pytest.approx(expected)


def test_each_form_of_a_summary_has_every_suite_and_method(summary: Summary) -> None:
    nested = as_json(summary)
    assert set(nested) == {"id", "more"} and set(nested["id"]) == {"greedy", "cmaes"}
    assert nested["id"]["greedy"]["clips"] == 5 and "error.mass" not in nested["id"]["greedy"]
    assert len(as_csv(summary).splitlines()) == 1 + 2 * 2 * 2
    again = from_csv(list(csv.DictReader(io.StringIO(as_csv(summary)))))
    assert as_csv(again) == as_csv(summary) and again.simulations == summary.simulations
    assert [row[-1] for row in table(again, {"error.mass": "mass"})[1]] == ["–"] * 4  # as_csv leaves it out
    header, rows = table(summary, {"iou": "IoU", "error.mass": "mass"})
    assert len(rows) == 4 and all(row[-1] == "–" for row in rows)
    assert markdown(header, rows).count("\n") == 6


def test_figures_are_well_formed_and_the_same_each_time(summary: Summary) -> None:
    for draw in (lambda: bars(summary, "iou", "IoU"), lambda: curves({"a": ([1, 2], [0.1, 0.4])}, "k", "IoU")):
        assert draw() == draw()
        assert ElementTree.fromstring(draw()).tag.endswith("svg")


def test_a_painted_mask_changes_its_object_alone(rng: np.random.Generator) -> None:
    frame = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
    mask = np.zeros((40, 60), np.uint8)
    mask[10:20, 10:30] = 1
    out = painted(frame, mask)
    far = np.ones((40, 60), bool)
    far[8:22, 8:32] = False
    assert (out[far] == frame[far]).all() and (out[12:18, 12:28] != frame[12:18, 12:28]).any()
    assert jpeg(tiled([("a", [frame, frame]), ("b", [out])]))[:2] == b"\xff\xd8"


def test_the_page_escapes_what_it_is_given() -> None:
    text = page(
        "<t>", "a < b", {"x": "<y>"}, [Section("s", "n & m", html_table(["<h>"], [["<c>"]]) + folded("f", "<p>"))]
    )
    for raw in ("<t>", "<y>", "<h>", "<c>", "<p>\n"):
        assert raw not in text.replace("<p>a", "").replace("<p>", "", 1)
    assert "&lt;c&gt;" in text and "n &amp; m" in text


def test_a_mean_curve_holds_each_clips_best_until_a_better_one() -> None:
    curve = mean_curve([([10, 20, 40], [0.1, 0.2, 0.6]), ([15, 30], [0.3, 0.5]), ([], [])], points=26)
    assert curve[0] == (15, pytest.approx((0.1 + 0.3) / 2))
    assert dict(curve)[20] == pytest.approx((0.2 + 0.3) / 2)
    assert curve[-1] == (40, pytest.approx((0.6 + 0.5) / 2))
    assert (np.diff([r for _, r in curve]) >= 0).all()
    assert mean_curve([]) == []
