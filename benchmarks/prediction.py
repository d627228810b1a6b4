"""Forecasts of the half second that was not fitted, on more clips than the default run has.

    dvc exp run -S seed=9 -S suites.id.clips=72 -S suites.real.path=CROSS_ENGINE predict@id predict@real
    python -m benchmarks.prediction

The first command fits the clips (CROSS_ENGINE: the absolute path of the folder with another engine's clips). The second
sums up data/predict: means with 95 % bootstrap intervals, and differences by clip from the forecast at constant
velocity. Writes benchmarks/results/prediction.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pipeline.clips.intervals import bootstrap_mean
from pipeline.report.markdown import markdown
from pipeline.report.tables import cell
from pipeline.shards.dataset import open_shards
from stages.graph.run import folder

OUT = Path("benchmarks/results/prediction.md")
SUITES = ("id", "real")
COLUMNS = {
    "search": "the fitted scene's replay",
    "moved_with_replay": "last masks, moved with the replay",
    "constant_velocity": "constant velocity",
    "frozen": "frozen masks",
}
RESAMPLES = 10_000


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rows = []
    for suite in SUITES:
        clips = [clip.row() for clip in open_shards(folder("predict", suite))]
        baseline = np.array([c["constant_velocity"] for c in clips])
        for column, words in COLUMNS.items():
            iou = np.array([c[column] for c in clips])
            gain = bootstrap_mean(iou - baseline, RESAMPLES)
            rows.append(
                [
                    suite,
                    words,
                    str(len(clips)),
                    cell(bootstrap_mean(iou, RESAMPLES)),
                    "–" if column == "constant_velocity" else cell(gain),
                ]
            )
    text = markdown(["suite", "method", "clips", "IoU, unseen half second", "less constant velocity"], rows)
    OUT.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
