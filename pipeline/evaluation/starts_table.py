"""Sequence IoU by start and budget, from the rows that benchmarks/starts.py writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.evaluation.tables import cell
from pipeline.metrics.intervals import Estimate

LAST = {"epe": "EPE, foreground", "epe_frame": "EPE, whole frame", "composition": "composition"}


def starts_table(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Header and a row for each suite and start: sequence IoU after each budget, and at the largest the other metrics
    and the largest penetration of any clip, mm."""
    budgets = sorted({int(r["simulations"]) for r in rows})
    found: dict[tuple[str, str], dict[tuple[int, str], Mapping[str, Any]]] = {}
    for r in rows:
        found.setdefault((r["suite"], r["start"]), {})[int(r["simulations"]), r["metric"]] = r
    header = ["suite", "start", "clips", *(f"IoU, {b} simulations" for b in budgets), *LAST.values(), "penetration, mm"]
    out = []
    for (suite, start), cells in found.items():
        last = max(b for b, metric in cells if metric == "iou")
        numbers = [_cell(cells.get((b, "iou"))) for b in budgets] + [_cell(cells.get((last, m))) for m in LAST]
        deepest = max(float(r["largest"]) for (_, metric), r in cells.items() if metric == "penetration")
        out.append([suite, start, str(cells[last, "iou"]["clips"]), *numbers, f"{1e3 * deepest:.2g}"])
    return header, out


def _cell(row: Mapping[str, Any] | None) -> str:
    return "–" if row is None else cell(Estimate.of_row(row))
