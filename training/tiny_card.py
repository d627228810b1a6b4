"""Measure the tiny model and write its model card.

    python -m training.tiny_card --model models/tiny --clips 100 --log .train/tiny/log.csv

Greedy answers on fresh clips of the suite `id` (1 to 3 objects), exact flow with noise; scores as in docs/formats.md.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from pipeline.clips.draw import Filters, draw_clips
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.evaluation.intervals import Estimate, bootstrap_mean
from pipeline.evaluation.scene_scores import score, true_reference
from pipeline.language.completion import read_completion
from pipeline.model.base import Base, load_base
from pipeline.model.generate import Sampling, generate
from pipeline.model.walker import Tries
from pipeline.physics.simulate import simulate
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from stages.params import PARAMS_FILE, Params
from stages.params_file import read_params_file
from training.examples import LAYOUT, Kind, picture

SHOWN = {"composition": "composition right", "iou_initial": "IoU, first frame", "iou": "IoU, sequence",
         "epe_frame": "EPE, whole frame, px"}  # fmt: skip
BATCH = 16


def shown(params: Params, suite: str, index: int, scene: Scene) -> np.ndarray:
    """The pictures of a clip, (T, H, W, 3) uint8."""
    schedule = Schedule(**params.clip.model_dump())
    trace = simulate(scene, schedule.seconds)
    view = pair_view(scene, *trace_pairs(trace, schedule), LAYOUT.width, LAYOUT.height)
    return picture(params, Kind(), suite, index, scene, trace, view)


def measure(base: Base, params: Params, suite: str, clips: int) -> list[dict[str, float]]:
    """Scores of the greedy answers on the first `clips` clips of a suite of 1 to 3 objects of that name."""
    schedule = Schedule(**params.clip.model_dump())
    distribution = Distribution(**params.sample.distribution.model_dump())
    filters = Filters(**params.sample.filters.model_dump())
    tries = Tries(base.codec)
    rows = []
    for start in tqdm(range(0, clips, BATCH), desc="clips", unit=f"{BATCH} clips"):
        indices = range(start, min(start + BATCH, clips))
        drawn = draw_clips(params.seed, suite, indices, distribution, filters, schedule, params.suites.id.objects)
        pictures = np.stack([shown(params, suite, i, s) for i, s in zip(indices, drawn.scenes, strict=True)])
        greedy = Sampling(reasoning=True, seconds=schedule.seconds)
        for scene, (answer,) in zip(drawn.scenes, generate(base, pictures, greedy, list(indices), tries), strict=True):
            rows.append(score(read_completion(answer.text).scene, true_reference(scene, schedule), schedule))
    return rows


CARD = """---
license: apache-2.0
library_name: transformers
pipeline_tag: video-text-to-text
---

# tiny

A Qwen2.5-VL architecture of {millions:.1f} million parameters with its own tokenizer. It reads the optical flow of a
one-second clip and writes the scene. It ships so that the whole graph runs on a laptop.

**Training.** `python -m training.tiny`, from random weights, on clips that are sampled, simulated and rasterised on the
way (the distribution of params.yaml, 1 to 4 objects, exact flow with noise like RAFT's): {clips} clips shown,
{fresh_clips} of them different, {minutes:.0f} minutes of one shared CPU core. A quarter of them without reasoning. Loss
on held-out clips: {loss:.3f} nats a free token.

**Scores** of greedy answers on {n} fresh clips of 1 to 3 objects (suite `{suite}`), with 95 % bootstrap intervals:

| metric | mean | interval |
| --- | --- | --- |
{rows}

`python -m training.tiny_card` measures them again.

**Limits.** It has seen too few clips to answer well: use it to try the machinery, and search (`--search`) to fit a
clip. Masses of bodies that touch nothing movable and the absolute scale are not determined by a clip.
"""


def card(base: Base, scores: dict[str, Estimate], log: dict[str, str], suite: str) -> str:
    """The model card as Markdown with the hub's front matter; log: the last row of the training's log."""
    return CARD.format(
        millions=sum(p.numel() for p in base.model.parameters()) / 1e6,
        clips=log["clips"],
        fresh_clips=log["fresh_clips"],
        minutes=float(log["minutes"]),
        loss=float(log["loss"]),
        n=next(iter(scores.values())).n,
        suite=suite,
        rows="\n".join(f"| {SHOWN[k]} | {e.mean:.3f} | {e.low:.3f} to {e.high:.3f} |" for k, e in scores.items()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/tiny"))
    parser.add_argument("--log", type=Path, default=Path(".train/tiny/log.csv"), help="the training's log")
    parser.add_argument("--clips", type=int, default=100)
    parser.add_argument("--suite", default="tiny-card", help="names the random numbers of the clips")
    args = parser.parse_args()
    torch.set_num_threads(2)
    params = read_params_file(PARAMS_FILE, Params)
    base = load_base(str(args.model))
    rows = measure(base, params, args.suite, args.clips)
    rng = np.random.default_rng(0)
    scores = {k: bootstrap_mean(np.array([r[k] for r in rows]), 2000, rng) for k in SHOWN}
    log = list(csv.DictReader(args.log.open()))[-1]
    text = card(base, scores, log, args.suite)
    (args.model / "README.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
