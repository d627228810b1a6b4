"""Scores of clips, summed up by suite and method: rows, CSV, Markdown, nested JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.metrics.intervals import Estimate, bootstrap_mean

NOTHING = Estimate(np.nan, np.nan, np.nan, 0)
COSTS = ("simulations", "seconds")


@dataclass(frozen=True)
class Summary:
    """estimates[suite, method][metric]; simulations, seconds [suite, method]: means a clip."""

    estimates: dict[tuple[str, str], dict[str, Estimate]]
    simulations: dict[tuple[str, str], float]
    seconds: dict[tuple[str, str], float]


def summarise(
    rows: Sequence[Mapping[str, Any]], metrics: Sequence[str], resamples: int, rng: np.random.Generator
) -> Summary:
    """Sum up rows that each have suite, method, simulations, seconds and some of the metrics (others count as none)."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["suite"], row["method"]), []).append(row)
    estimates = {
        key: {m: bootstrap_mean(np.array([r.get(m, np.nan) for r in group], float), resamples, rng) for m in metrics}
        for key, group in groups.items()
    }
    spent = [{key: float(np.mean([r[name] for r in g])) for key, g in groups.items()} for name in COSTS]
    return Summary(estimates, *spent)


def as_json(summary: Summary) -> dict[str, Any]:
    """suite -> method -> metric -> mean, without those that rest on no clip: what `dvc metrics` shows."""
    out: dict[str, Any] = {}
    for (suite, method), metrics in summary.estimates.items():
        means = {m: round(e.mean, 4) for m, e in metrics.items() if e.n}
        out.setdefault(suite, {})[method] = {**means, "clips": metrics["iou"].n}
    return out


def as_csv(summary: Summary) -> str:
    """One row per suite, method and metric with mean, interval and number of clips."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["suite", "method", "simulations", "metric", "mean", "low", "high", "clips"])
    for (suite, method), metrics in summary.estimates.items():
        for name, e in metrics.items():
            if e.n:
                numbers = [f"{v:.5g}" for v in (e.mean, e.low, e.high)]
                writer.writerow([suite, method, f"{summary.simulations[suite, method]:g}", name, *numbers, e.n])
    return text.getvalue()


def from_csv(rows: Sequence[Mapping[str, str]]) -> Summary:
    """The summary of which `as_csv` wrote the rows; seconds are not in them, and NaN."""
    estimates: dict[tuple[str, str], dict[str, Estimate]] = {}
    simulations = {(r["suite"], r["method"]): float(r["simulations"]) for r in rows}
    metrics = dict.fromkeys(r["metric"] for r in rows)
    for key in simulations:
        estimates[key] = dict.fromkeys(metrics, NOTHING)
    for r in rows:
        estimates[r["suite"], r["method"]][r["metric"]] = Estimate.of_row(r)
    return Summary(estimates, simulations, dict.fromkeys(simulations, np.nan))


def cell(e: Estimate) -> str:
    """`0.53 (0.47-0.60)`, or a dash."""
    return f"{e.mean:.3g} ({e.low:.3g}–{e.high:.3g})" if e.n else "–"


def table(summary: Summary, columns: Mapping[str, str]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table with one line per suite and method; columns: metric -> heading, a dash where there is
    no such metric."""
    header = ["suite", "method", "clips", *COSTS, *columns.values()]
    rows = []
    for key, metrics in summary.estimates.items():
        cost = [
            f"{summary.simulations[key]:.4g}",
            "–" if np.isnan(summary.seconds[key]) else f"{summary.seconds[key]:.2g}",
        ]
        rows.append([*key, str(metrics["iou"].n), *cost, *(cell(metrics.get(m, NOTHING)) for m in columns)])
    return header, rows


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"
