"""Measure the model of objects and write its model card.

    python -m training.objects.card [--model models/objects] [--checkpoints .train/objects/clips-*.safetensors]

Run `python -m benchmarks.learned objects --model models/objects` first: the scores with the masks of the network and
RAFT's flow are taken from benchmarks/results/learned. This module scores greedy answers on fresh clips with the errors
of the training; a test scores the shipped weights again on some of these clips. With --checkpoints it scores those as
well, and keeps the curve beside the model (curve.csv).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import read_rows, write_rows
from pipeline.evaluation.scene_scores import score, true_reference
from pipeline.evaluation.summary import from_csv
from pipeline.evaluation.tables import markdown
from pipeline.model.sampling import Sampling
from pipeline.objects.answering import load_objects, write_scenes
from pipeline.objects.network import ObjectsNetwork, ObjectsSize
from pipeline.shards.clip_rng import clip_rng
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.checkpoint import load_checkpoint
from training.drawn_scenes import drawn_scenes
from training.model_card import CHECKED, LEARNED, SHOWN, SUITES, exact_table, table_of
from training.objects.examples import drawn_example, poses_of

SUITE = "objects-card"  # names the random streams of the clips
CURVE, LOG = "curve.csv", "log.csv"
COLUMNS = {
    "composition": "composition right",
    "iou_initial": "IoU, first frame",
    "iou": "IoU, sequence",
    "error.camera_pitch": "pitch, deg",
    "error.position": "position, m",
    "error.velocity": "velocity, m/s",
    "error.size": "size, m",
}


def measure(network: ObjectsNetwork, params: Params, clips: int) -> list[dict[str, float]]:
    """Scores of the greedy answers on the first `clips` clips of `SUITE`, of 1 to 3 objects."""
    schedule = Schedule(**params.clip.model_dump())
    scenes = drawn_scenes(params, params.seed, SUITE, range(clips), params.suites.id.objects)
    rows = []
    poses = poses_of(scenes, schedule)
    for k, scene in enumerate(tqdm(scenes, unit="clip", disable=None)):
        shown = drawn_example(scene, poses[k], schedule, clip_rng(params.seed, SUITE, k, "errors")).instances
        if not len(shown):  # every mask is too small
            rows.append(dict.fromkeys(SHOWN, 0.0))
            continue
        (answer,), _ = write_scenes(network, shown, Sampling(seconds=schedule.seconds), 0)
        rows.append(score(answer, true_reference(scene, schedule), schedule))
    return rows


def curve_row(path: Path, params: Params, clips: int) -> dict[str, float]:
    """The scores of one checkpoint, means over the clips that have them."""
    state = load_checkpoint(path)
    size = {**state["size"], "channels": tuple(state["size"]["channels"])}
    network = ObjectsNetwork(ObjectsSize(**size))
    network.load_state_dict(state["network"])
    return means_of(measure(network.eval(), params, clips), state["clips"])


def means_of(rows: list[dict[str, float]], seen: int) -> dict[str, float]:
    """A row of the curve: means over the clips that have a score. seen: clips that the training had seen."""
    return {"clips_seen": seen, **{name: float(np.mean([r[name] for r in rows if name in r])) for name in COLUMNS}}


CARD = """---
license: apache-2.0
---

# objects

A network of {millions:.1f} million parameters that reads the bodies of a clip one by one, each by crops of its mask and
of the optical flow, and writes the scene ([docs/objects.md](../../docs/objects.md)). `dynamics infer` and the graph use
it by default.

**Training.** `python -m training.objects`, from random weights, on clips that were sampled, simulated and rasterised
beforehand (the distribution of params.yaml, 1 to 4 objects without the four held-out combinations; masks with errors
like those of models/masks, flow with noise like RAFT's): {clips:,} clips in {minutes:.0f} minutes of one shared core
(`log.csv`); examples that were kept in files are seen more than once.

**Scores** before any search, on fresh clips (`python -m benchmarks.learned objects`): masks by models/masks, RAFT's
flow, and for greedy answers the shape prior of the network for shapes; means with 95 % bootstrap intervals:

{scores}
{suites}.

Greedy, on {n} fresh clips of 1 to 3 objects with the errors of the training (`python -m training.objects.card`; a test
scores the first {checked} again):

{exact}
**The curve** of the same scores and of errors against clips seen, at full learning rate, averaged weights; in the last
line the weights that ship, after the learning rate fell:

{curve}
**Limits.** What the network for masks misses, this model cannot see: on `id` the number of bodies found is wrong more
often than a shape. A clip does not determine the absolute scale, nor the mass of a body that touches nothing movable.
It writes no reasons of its own: the events of `<think>` are those of the scene that it answers, simulated. The search
(`--search`) fits a clip better than any answer of this model.
"""


def curve_table(rows: list[dict[str, str]]) -> str:
    """A line per number of clips."""
    lines = [[f"{int(float(r['clips_seen'])):,}", *(f"{float(r[name]):.3g}" for name in COLUMNS)] for r in rows]
    return markdown(["clips seen", *COLUMNS.values()], lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/objects"))
    parser.add_argument("--checkpoints", type=Path, nargs="*", default=[])
    parser.add_argument("--clips", type=int, default=96)
    args = parser.parse_args()
    torch.set_num_threads(2)
    params = read_params_file(PARAMS_FILE, Params)
    model = load_objects(str(args.model)).model
    rows, log = measure(model, params, args.clips), read_rows(args.model / LOG)[-1]
    seen = int(float(log["clips"]))
    if args.checkpoints:
        curve = [curve_row(path, params, args.clips) for path in args.checkpoints]
        curve = [*sorted(curve, key=lambda r: r["clips_seen"]), means_of(rows, seen)]
        write_rows(args.model / CURVE, curve, digits=5)
    text = CARD.format(
        millions=sum(p.numel() for p in model.parameters()) / 1e6,
        clips=seen,
        minutes=float(log["minutes"]),
        scores=table_of(from_csv(read_rows(LEARNED)), "objects"),
        suites="; ".join(f"{name}: {what}" for name, what in SUITES.items()),
        n=len(rows),
        checked=CHECKED,
        exact=exact_table(rows),
        curve=curve_table(read_rows(args.model / CURVE)),
    )
    (args.model / "README.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
