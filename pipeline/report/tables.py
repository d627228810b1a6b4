"""Tables as a header and rows of text: scores, parameter errors, samples, pairs of models, checkpoints, starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.clips.intervals import NO_CLIPS, MeanInterval
from pipeline.report.summary import COSTS, Summary

Table = tuple[Sequence[str], Sequence[Sequence[str]]]
Rows = Sequence[Mapping[str, Any]]

#: Metric -> heading of the table of scores.
SCORES = {
    "composition": "composition",
    "iou_initial": "IoU, first frame",
    "iou": "IoU, sequence",
    "foreground_iou": "IoU, foreground",
    "epe_first": "EPE, first pair",
    "epe": "EPE, foreground",
    "epe_frame": "EPE, whole frame",
    "penetration": "penetration, m",
    "valid": "valid",
}
#: The same for the errors of parameters, with their units.
ERRORS = {
    "error.camera_height": "camera height, m",
    "error.camera_pitch": "camera pitch, deg",
    "error.fov": "field of view, deg",
    "error.gravity": "gravity, m/s²",
    "error.size": "size, m",
    "error.position": "position, m",
    "error.velocity": "velocity, m/s",
    "error.angular_velocity": "angular velocity, rad/s",
    "error.orientation": "orientation, deg",
    "error.mass": "mass, kg",
    "error.sliding_friction": "sliding friction",
    "error.rolling_friction": "rolling friction, m",
    "error.damping": "damping",
}
#: The same for forecasts of the second half of a clip.
FORECAST = {"iou": "IoU, unseen half", "seen": "IoU, seen half"}
#: The same for searches, at their largest budget.
LARGEST_BUDGET = {"epe": "EPE, foreground", "epe_frame": "EPE, whole frame", "composition": "composition"}
SAMPLES = (1, 2, 4, 8, 16, 32)
NONE = "–"


def cell(interval: MeanInterval) -> str:
    """`0.53 (0.47–0.60)`, or a dash."""
    return f"{interval.mean:.3g} ({interval.low:.3g}–{interval.high:.3g})" if interval.n else NONE


def metrics_table(summary: Summary, columns: Mapping[str, str], costs: bool = True) -> Table:
    """A line per suite and method: clips, simulations if asked for, the metrics of `columns` (metric -> heading)."""
    rows = []
    for key, metrics in summary.intervals.items():
        spent = [f"{summary.simulations[key]:.4g}"] if costs else []
        rows.append([*key, str(metrics["iou"].n), *spent, *(cell(metrics.get(m, NO_CLIPS)) for m in columns)])
    return ["suite", "method", "clips", *["simulations"] * costs, *columns.values()], rows


def times_table(summary: Summary) -> Table:
    """A line per suite and method: simulations and seconds a clip, apart from what equal runs have in common."""
    rows = [[*key, f"{summary.simulations[key]:.4g}", f"{s:.2g}"] for key, s in summary.seconds.items() if s == s]
    return ["suite", "method", *COSTS], rows


def headline_table(summary: Summary) -> Table:
    """A line per suite: clips, and the sequence IoU of every method."""
    suites = dict.fromkeys(suite for suite, _ in summary.intervals)
    methods = list(dict.fromkeys(method for _, method in summary.intervals))
    nothing = {"iou": NO_CLIPS}
    rows = []
    for suite in suites:
        found = [summary.intervals.get((suite, method), nothing)["iou"] for method in methods]
        rows.append([suite, str(max(e.n for e in found)), *map(cell, found)])
    return ["suite", "clips", *methods], rows


def samples_table(summary: Summary) -> Table:
    """Sequence IoU of the best of K samples, of the methods that drew samples."""
    one = f"iou@{SAMPLES[0]}"
    sampled = {key: found for key, found in summary.intervals.items() if found.get(one, NO_CLIPS).n}
    columns = {f"iou@{k}": f"K = {k}" for k in SAMPLES}
    return metrics_table(Summary(sampled, summary.simulations, summary.seconds), columns)


def differences_table(rows: Rows, metrics: Mapping[str, str]) -> Table:
    """A line per pair of models and metric.

    Args:
        rows: With suite, first, second, metric, what (first, second or difference) and interval.
        metrics: Metric -> its name in the table.
    """
    found: dict[tuple[str, str, str, str], dict[str, MeanInterval]] = {}
    for r in rows:
        found.setdefault((r["suite"], r["first"], r["second"], r["metric"]), {})[r["what"]] = MeanInterval.of_row(r)
    header = ["suite", "first", "second", "metric", "clips", "of the first", "of the second", "difference by clip"]
    return header, [
        [*key, metrics[metric], str(e["difference"].n), cell(e["first"]), cell(e["second"]), cell(e["difference"])]
        for (*key, metric), e in found.items()
    ]


def starts_table(rows: Rows) -> Table:
    """A line per suite and start of the search, from rows of suite, start, simulations, metric, interval and largest.

    Columns: sequence IoU after each budget; at the largest budget the other metrics, and the largest penetration of
    any clip, mm.
    """
    budgets = sorted({int(r["simulations"]) for r in rows})
    found: dict[tuple[str, str], dict[tuple[int, str], Mapping[str, Any]]] = {}
    for r in rows:
        found.setdefault((r["suite"], r["start"]), {})[int(r["simulations"]), r["metric"]] = r
    lines = []
    for (suite, start), cells in found.items():
        last = max(budget for budget, metric in cells if metric == "iou")
        columns = [*((budget, "iou") for budget in budgets), *((last, metric) for metric in LARGEST_BUDGET)]
        numbers = [cell(MeanInterval.of_row(cells[c]) if c in cells else NO_CLIPS) for c in columns]
        deepest = max(float(r["largest"]) for (_, metric), r in cells.items() if metric == "penetration")
        lines.append([suite, start, str(cells[last, "iou"]["clips"]), *numbers, f"{1e3 * deepest:.2g}"])
    by_budget = (f"IoU, {budget} simulations" for budget in budgets)
    return ["suite", "start", "clips", *by_budget, *LARGEST_BUDGET.values(), "penetration, mm"], lines
