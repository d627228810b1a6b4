"""The page of the scores, made from few numbers."""

import re
from pathlib import Path

import numpy as np

from pipeline.report.determined import KindSpreads
from pipeline.report.event_scores import EVENT_METRICS, KIND_METRICS
from pipeline.report.scores_page import RunScores, ShownClip, benchmark_tables, scores_page
from pipeline.report.summary import summarise
from pipeline.report.tables import ERRORS, FORECAST
from pipeline.report.written_report import prose_by_heading

RESULTS, REPORTS = Path("benchmarks/results"), Path("reports")


def run_of(rng: np.random.Generator) -> RunScores:
    rows = [
        {"suite": s, "method": m, "simulations": 8, "seconds": 0.5, "iou": float(rng.random())}
        for s in ("id", "real")
        for m in ("greedy", "search")
        for _ in range(3)
    ]
    curve = [{"series": "id", "k": k, "simulations": k, "iou": 0.1 * k, "reward": 0.1 * k} for k in (1, 2, 3)]
    summary = summarise(rows, ["iou", "composition", *ERRORS], 50)
    losses = {"train": ([1.0, 2.0], [2.0, 1.5])}
    spreads = {"mass": KindSpreads("factor", [2.0], [0.4], [1.6])}
    return RunScores(
        summary=summary,
        best_of_k=curve,
        searches=curve,
        training=losses,
        determined=spreads,
        forecast=summarise(rows, list(FORECAST), 50),
        events=summarise(rows, [], 50, f1_metrics=[*EVENT_METRICS, *KIND_METRICS]),
    )


def test_pictures_come_first_then_one_table_then_everything_else_folded(rng: np.random.Generator) -> None:
    clips = {
        suite: [ShownClip(f"<i>{suite}{k}</i>", "stills", "<think>", "a: 1") for k in range(2)]
        for suite in ("id", "real")
    }
    text = scores_page(run_of(rng), clips, {"machine": "abacus & sons"}, REPORTS, RESULTS)
    shown, _, rest = text.partition('<details class="section">')
    assert "abacus &amp; sons" in shown and shown.count("<table") == 1
    assert shown.index("<i>id0</i>") < shown.index("<i>real0</i>") < shown.index("<table")
    assert "<i>id1</i>" in rest and "&lt;think&gt;" in rest and "third digit" in shown
    folded = ["Curves", *list(prose_by_heading(REPORTS / "README.md"))[1:], "Clips of id", "Clips of real"]
    folded += [title for tables in benchmark_tables(RESULTS).values() for title in tables]
    assert re.findall(r'<details class="section"><summary>(.*?)</summary>', text) == [
        t.replace("'", "&#39;") for t in folded
    ]
