"""Compare what was discovered with what was hidden: the only stage that sees both.

Reads data/discover/measured, data/hide/truth. Writes reports/discovery.json (metrics), discovery.csv (a row per world),
discovery.md, discovery.svg (confusion matrix). Run: python -m stages.verify
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.csv_rows import write_rows
from pipeline.evaluation.tables import markdown
from pipeline.hidden.confusion_figure import confusion_figure
from pipeline.hidden.judge import Judgement, confusion, judge
from pipeline.metrics.intervals import wilson
from pipeline.shards.dataset import open_shards
from pipeline.shards.output_errors import writing_to
from stages.graph.run import folder, run

REPORTS = Path("reports")


def row_of(world: int, judged: Judgement, report: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    gap = report["gap"]
    return {
        "world": world,
        "hidden": judged.truth,
        "answer": "+".join(report["verdict"]["effects"]) or "none",
        "equivalent": " ".join("/".join(s) for s in report["verdict"]["equivalent"]),
        "right": judged.right,
        "confidence": round(report["verdict"]["confidence"], 3),
        "engine": truth["engine"],
        "scenario": truth["scenario"],
        "before_mm": round(1e3 * gap["before"], 3),
        "after_mm": round(1e3 * gap["after"], 3),
        "floor_mm": round(1e3 * gap["noise_floor"], 3),
    }


def main() -> None:
    found, hidden = open_shards(folder("discover", "measured")), open_shards(folder("hide", "truth"))
    judged, rows = [], []
    for world in range(len(found)):
        report, truth = json.loads(found[world].row()["report"]), json.loads(hidden[world].row()["truth"])
        judged.append(judge(report["verdict"], truth))
        rows.append(row_of(world, judged[-1], report, truth))
    there = [j for j in judged if j.truth != "none"]
    right = sum(j.right for j in there)
    errors = [e for j in judged for e in j.errors.values()]
    summary = {
        "worlds": len(judged),
        "named": right / max(len(there), 1),
        "named_interval": wilson(right, len(there)),
        "false_claims": sum(j.false for j in judged) / max(len(judged), 1),
        "parameter_error": float(np.median(errors)) if errors else None,
    }
    with writing_to(REPORTS):
        REPORTS.mkdir(exist_ok=True)
        (REPORTS / "discovery.svg").write_text(confusion_figure(*confusion(judged)))
        write_rows(REPORTS / "discovery.csv", rows)
        (REPORTS / "discovery.md").write_text(markdown(list(rows[0]), [[str(v) for v in row.values()] for row in rows]))
        (REPORTS / "discovery.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(
        f"verify: {right} of {len(there)} hidden effects named, {sum(j.false for j in judged)} false claims", flush=True
    )


if __name__ == "__main__":
    run(main)
