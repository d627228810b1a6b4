"""Scores of a training's checkpoints on the same fresh clips, against the number of clips trained on.

    python -m benchmarks.scaling .train/tiny/checkpoint_*.safetensors [--clips 96]

The checkpoints should have the same learning rate. The clips have 1 to 3 objects, with exact flow and the noise of the
training; the answers are greedy. Writes benchmarks/results/learned/scaling.csv, which the report shows with an
extrapolation to ten and a hundred times as many clips.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from training.tiny.card import measure
from training.tiny.examples import CHUNK
from training.tiny.trainer import read_checkpoint

from benchmarks.learned import RESAMPLES, RESULTS
from pipeline.csv_rows import write_rows
from pipeline.evaluation.tables import CHECKPOINT, markdown, scaling_table
from pipeline.metrics.intervals import bootstrap_mean
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file


def checkpoint_rows(path: Path, params: Params, clips: int) -> list[dict[str, Any]]:
    """A row for each metric of one checkpoint."""
    base, progress = read_checkpoint(path)
    scores = measure(base, params, clips)
    head = {"clips_seen": progress.chunk * CHUNK, "minutes": f"{progress.seconds / 60:.1f}"}
    found = {m: bootstrap_mean(np.array([s[m] for s in scores]), RESAMPLES) for m in CHECKPOINT}
    return [{**head, "metric": m, **e.row()} for m, e in found.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", type=Path, nargs="+")
    parser.add_argument("--clips", type=int, default=96)
    args = parser.parse_args()
    torch.set_num_threads(2)
    params = read_params_file(PARAMS_FILE, Params)
    rows = [row for path in args.checkpoints for row in checkpoint_rows(path, params, args.clips)]
    write_rows(RESULTS / "scaling.csv", rows, digits=5)
    print(markdown(*scaling_table(rows)))


if __name__ == "__main__":
    main()
