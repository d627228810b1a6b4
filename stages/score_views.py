"""Tables of the scenes that were found in clips as people film them.

Reads data/tracks/views. Writes reports/views.md (a row per kind of view, a row per clip) and reports/views.json
(metrics). Run: python -m stages.score_views
"""

import json
from pathlib import Path

from pipeline.report.view_tables import ViewScore, clips_table, figures, kinds_table
from pipeline.shards.dataset import open_shards
from pipeline.shards.output_errors import writing_to
from stages.graph.run import folder, run

REPORTS, SUITE = Path("reports"), "views"


def main() -> None:
    clips = open_shards(folder("tracks", SUITE))
    scores = [ViewScore(**row) for row in clips.table().to_pylist()] if len(clips) else []
    metrics, text = figures(scores), "The suite has no clips.\n"
    if scores:
        text = f"{kinds_table(scores)}\n{clips_table(scores)}"
    with writing_to(REPORTS):
        REPORTS.mkdir(exist_ok=True)
        (REPORTS / "views.md").write_text(text, encoding="utf-8")
        (REPORTS / "views.json").write_text(json.dumps(metrics, indent=1) + "\n", encoding="utf-8")
    print(text, end="", flush=True)


if __name__ == "__main__":
    run(main)
