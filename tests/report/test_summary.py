"""Summaries of scores and the forms in which they are written, and curves."""

import csv
import io
from itertools import combinations

import numpy as np
import pytest

from pipeline.report.markdown import markdown
from pipeline.report.summary import (
    Summary,
    as_csv,
    as_json,
    best_of_k_curve,
    from_csv,
    mean_best_so_far,
    summarise,
)
from pipeline.report.tables import headline_table, metrics_table


@pytest.fixture
def summary(rng: np.random.Generator) -> Summary:
    rows = [
        {"suite": s, "method": m, "simulations": 8, "seconds": 0.5, "iou": float(rng.random()), "composition": 1.0}
        for s in ("id", "more")
        for m in ("greedy", "cmaes")
        for _ in range(5)
    ]
    return summarise(rows, ["iou", "composition", "error.mass"], 200)


def test_the_best_of_k_curve_is_the_mean_over_all_subsets(rng: np.random.Generator) -> None:
    reward, score = rng.random(6), rng.random(6)
    expected = [
        np.mean([score[max(c, key=lambda i: reward[i])] for c in combinations(range(6), k)]) for k in range(1, 7)
    ]
    assert best_of_k_curve(reward, score) == pytest.approx(expected)


def test_each_form_of_a_summary_has_every_suite_and_method(summary: Summary) -> None:
    nested = as_json(summary)
    assert set(nested) == {"id", "more"} and set(nested["id"]) == {"greedy", "cmaes"}
    assert nested["id"]["greedy"]["clips"] == 5 and "error.mass" not in nested["id"]["greedy"]
    assert len(as_csv(summary).splitlines()) == 1 + 2 * 2 * 2
    again = from_csv(list(csv.DictReader(io.StringIO(as_csv(summary)))))
    assert as_csv(again) == as_csv(summary) and again.simulations == summary.simulations
    assert [row[-1] for row in metrics_table(again, {"error.mass": "mass"})[1]] == ["–"] * 4  # as_csv leaves it out
    header, rows = metrics_table(summary, {"iou": "IoU", "error.mass": "mass"})
    assert len(rows) == 4 and all(row[-1] == "–" for row in rows)
    assert markdown(header, rows).count("\n") == 6
    assert metrics_table(summary, {"iou": "IoU"}, costs=False)[0] == ["suite", "method", "clips", "IoU"]


def test_the_headline_table_has_a_line_per_suite_and_a_column_per_method(summary: Summary) -> None:
    some = {key: found for key, found in summary.intervals.items() if key != ("more", "cmaes")}
    header, rows = headline_table(Summary(some, summary.simulations, summary.seconds))
    assert header == ["suite", "clips", "greedy", "cmaes"]
    assert [row[0] for row in rows] == ["id", "more"] and rows[1][-1] == "–" and rows[0][-1] != "–"


def test_the_mean_of_the_best_so_far_holds_each_clips_best_until_a_better_one() -> None:
    histories = [([10, 20, 40], [0.1, 0.2, 0.6]), ([15, 30], [0.3, 0.5]), ([], [])]
    curve = mean_best_so_far(lambda: histories, points=26)
    assert curve[0] == (15, pytest.approx((0.1 + 0.3) / 2))
    assert dict(curve)[20] == pytest.approx((0.2 + 0.3) / 2)
    assert curve[-1] == (40, pytest.approx((0.6 + 0.5) / 2))
    assert (np.diff([r for _, r in curve]) >= 0).all()
    assert mean_best_so_far(list) == []
