"""Tables of a model card: scores on RAFT's flow from the benchmark, and on clips that are scored for the card."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.evaluation.summary import Summary
from pipeline.evaluation.tables import cell, markdown
from pipeline.metrics.intervals import bootstrap_mean

LEARNED = Path("benchmarks/results/learned/learned.csv")
CHECKED = 16  # clips that the test of a card scores again
SHOWN = {
    "composition": "composition right",
    "iou_initial": "IoU, first frame",
    "iou": "IoU, sequence",
    "epe_frame": "EPE, whole frame, px",
}
SUITES = {
    "id": "1 to 3 objects",
    "held_out": "4 objects in combinations that the training leaves out",
    "more": "5 and 6 objects, more than in the training",
    "real": "clips of another engine and renderer",
}


def table_of(learned: Summary, name: str) -> str:
    """The rows of the model of a name, by suite."""
    rows = [
        [suite, method.removeprefix(name).strip(", ") or "greedy", *(cell(found[m]) for m in SHOWN)]
        for (suite, method), found in learned.intervals.items()
        if method.split(",")[0] == name
    ]
    return markdown(["suite", "answer", *SHOWN.values()], rows)


def exact_table(rows: list[dict[str, float]]) -> str:
    """Means over all clips with intervals, and over the first `CHECKED` of them."""
    out = []
    for key, name in SHOWN.items():
        values = np.array([r[key] for r in rows])
        out.append([name, cell(bootstrap_mean(values, 2000)), f"{values[:CHECKED].mean():.3f}"])
    return markdown(["metric", "mean", f"of the first {CHECKED}"], out)
