"""Compare what was discovered with what was hidden: the only stage that sees both.

Reads data/discover/measured, data/hide/truth (worlds given as tracks), data/discover/filmed, data/hide/truth_filmed (as
videos). Writes reports/discovery.json (metrics; of the filmed worlds under `filmed`), discovery.csv (a row per world),
discovery.md, discovery.svg (confusion matrix of the worlds given as tracks). Run: python -m stages.verify
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.intervals import wilson
from pipeline.csv_rows import write_rows
from pipeline.hidden.confusion_figure import confusion_figure
from pipeline.hidden.judge import Judgement, confusion, judge
from pipeline.report.markdown import markdown
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.output_errors import writing_to
from stages.graph.run import folder, run

REPORTS = Path("reports")
WHEN = ("before", "after")
MILLIMETRES = {"before": "before", "after": "after", "floor": "noise_floor"}  # column, without unit: key of `gap`


@dataclass(frozen=True)
class Verified:
    """A world's judgement, None where nothing could be measured, and its row of the table."""

    judged: Judgement | None
    row: dict[str, Any]


def verified(world: int, given: str, report: dict[str, Any] | None, truth: dict[str, Any]) -> Verified:
    """Judge one world.

    Args:
        world: Its number.
        given: "tracks" or "video": what the discovery was given.
        report: Of the discovery; None where nothing could be measured.
        truth: What was hidden.
    """
    row: dict[str, Any] = {"world": world, "from": given}
    same = {"engine": truth["engine"], "scenario": truth["scenario"]}
    if report is None:
        hidden = "+".join(sorted(e["name"] for e in truth["effects"])) or "none"
        return Verified(None, row | {"hidden": hidden, "answer": "not measured", "right": False} | same)
    judged, verdict, gap = judge(report["verdict"], truth), report["verdict"], report["gap"]
    row |= {
        "hidden": judged.truth,
        "answer": "+".join(verdict["effects"]) or "none",
        "equivalent": " ".join("/".join(s) for s in verdict["equivalent"]),
        "right": judged.right,
        "confidence": round(verdict["confidence"], 3),
    }
    row |= same | {f"{name}_mm": round(1e3 * gap[key], 3) for name, key in MILLIMETRES.items()}
    ious = {f"iou_{when}": gap.get(f"sequence_iou_{when}") for when in WHEN}
    row |= {name: round(iou, 3) for name, iou in ious.items() if iou is not None}
    return Verified(judged, row)


def worlds_of(given: str, found: ShardedDataset, hidden: ShardedDataset) -> list[Verified]:
    """All worlds of a pair of folders; given: "tracks" or "video"."""
    out = []
    for world in range(len(found)):
        report, truth = found[world].row()["report"], json.loads(hidden[world].row()["truth"])
        out.append(verified(world, given, None if report is None else json.loads(report), truth))
    return out


def summary(worlds: Sequence[Verified]) -> dict[str, Any]:
    """The metrics of some worlds."""
    judged = [w.judged for w in worlds if w.judged is not None]
    there = [w for w in worlds if w.row["hidden"] != "none"]
    right = sum(w.row["right"] for w in there)
    errors = [e for j in judged for e in j.errors.values()]
    return {
        "worlds": len(worlds),
        "named": right / max(len(there), 1),
        "named_interval": wilson(right, len(there)),
        "false_claims": sum(j.false for j in judged) / max(len(worlds), 1),
        "parameter_error": float(np.median(errors)) if errors else None,
    }


def main() -> None:
    tracks, video = (
        worlds_of(given, open_shards(folder("discover", found)), open_shards(folder("hide", truth)))
        for given, found, truth in (("tracks", "measured", "truth"), ("video", "filmed", "truth_filmed"))
    )
    every = [*tracks, *video]
    columns = list(dict.fromkeys(name for w in every for name in w.row))
    rows = [{name: w.row.get(name, "") for name in columns} for w in every]
    filmed = summary(video) | {"not_measured": sum(w.judged is None for w in video)}
    with writing_to(REPORTS):
        REPORTS.mkdir(exist_ok=True)
        judged = [w.judged for w in tracks if w.judged is not None]
        (REPORTS / "discovery.svg").write_text(confusion_figure(*confusion(judged)))
        write_rows(REPORTS / "discovery.csv", rows)
        (REPORTS / "discovery.md").write_text(markdown(columns, [[str(v) for v in row.values()] for row in rows]))
        (REPORTS / "discovery.json").write_text(json.dumps(summary(tracks) | {"filmed": filmed}, indent=1) + "\n")
    for given, worlds in (("tracks", tracks), ("video", video)):
        there = [w for w in worlds if w.row["hidden"] != "none"]
        false = sum(w.judged is not None and w.judged.false for w in worlds)
        print(
            f"verify, from {given}: {sum(w.row['right'] for w in there)} of {len(there)} hidden effects named, "
            f"{false} false claims",
            flush=True,
        )


if __name__ == "__main__":
    run(main)
