"""Tables of the model's own answers: what more samples buy, pairs of models compared, what more clips would buy.

The rows are those that benchmarks/learned.py and benchmarks/scaling.py write.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.evaluation.tables import NOTHING, Summary, cell, table
from pipeline.metrics.intervals import Estimate

SAMPLES = (1, 2, 4, 8, 16, 32)
FURTHER = (10, 100)
#: Metric -> heading of the table of a training's checkpoints.
CHECKPOINT = {"composition": "composition", "iou_initial": "IoU, first frame", "iou": "IoU, sequence"}
Table = tuple[list[str], list[list[str]]]
Rows = Sequence[Mapping[str, Any]]


def samples_table(summary: Summary) -> Table:
    """Sequence IoU of the best of K samples, of the methods that have such."""
    one = f"iou@{SAMPLES[0]}"
    sampled = {key: found for key, found in summary.estimates.items() if found.get(one, NOTHING).n}
    return table(Summary(sampled, summary.simulations, summary.seconds), {f"iou@{k}": f"K = {k}" for k in SAMPLES})


def differences_table(rows: Rows) -> Table:
    """Rows of suite, first, second, what (first, second or difference) and an estimate: a line for each pair."""
    found: dict[tuple[str, str, str], dict[str, Estimate]] = {}
    for r in rows:
        found.setdefault((r["suite"], r["first"], r["second"]), {})[r["what"]] = Estimate.of_row(r)
    header = ["suite", "first", "second", "clips", "IoU of the first", "IoU of the second", "difference by clip"]
    return header, [
        [*key, str(e["difference"].n), cell(e["first"]), cell(e["second"]), cell(e["difference"])]
        for key, e in found.items()
    ]


def scaling_table(rows: Rows) -> Table:
    """Rows of clips_seen, minutes, metric and an estimate, one line a checkpoint; and what a straight line in the
    scores' logit against the logarithm of the clips says for `FURTHER` times as many clips, with the range when any one
    checkpoint is left out. Of fewer than three checkpoints nothing is said."""
    seen = sorted({int(r["clips_seen"]) for r in rows})
    found = {(int(r["clips_seen"]), r["metric"]): Estimate.of_row(r) for r in rows}
    minutes = {int(r["clips_seen"]): float(r["minutes"]) for r in rows}
    lines = [[f"{n:,}", f"{minutes[n]:.0f}", *(cell(found[n, m]) for m in CHECKPOINT)] for n in seen]
    if len(seen) > 2:
        for factor in FURTHER:
            cells = [_foretold(seen, [found[n, m].mean for n in seen], factor) for m in CHECKPOINT]
            lines.append([f"{factor * seen[-1]:,} (foretold)", "–", *cells])
    return ["clips seen", "minutes", *CHECKPOINT.values()], lines


def _foretold(seen: Sequence[int], values: Sequence[float], factor: int) -> str:
    x, y = np.log(np.array(seen, float)), np.clip(values, 1e-3, 1 - 1e-3)
    logit = np.log(y / (1 - y))
    kept = [np.arange(len(x)) != k for k in range(len(x))]
    at = np.log(factor * seen[-1])
    odds = np.exp([np.polyval(np.polyfit(x[k], logit[k], 1), at) for k in (slice(None), *kept)])
    all_of_them, *without = odds / (1 + odds)
    return f"{all_of_them:.3g} ({min(without):.3g} to {max(without):.3g})"
