"""The model card of our RAFT: what it is, how it was trained, and its scores, measured when the card is written."""

from __future__ import annotations

from pathlib import Path

import torch

from pipeline.report.markdown import markdown
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import RAFT
from pipeline.vision.rendering.render_backend import choose_backend
from training.raft.flow_scores import Estimator, Score, cross_engine, cross_engine_folder, held_out, score
from training.raft.pair_stream import Batch

SEED = 77_000_001  # of the card's pairs; neither the training nor its log uses it
ITERATIONS = 4

COLD_START = "It starts from zero flow, as in the paper."
WARM_START = (
    "It refines the flow of OpenCV's DIS ({preset}), by the warm start of the paper's section 3.3: `load_raft` reads "
    "the preset from `config.json`, and `flow` computes DIS first."
)

COLUMNS = ("pairs", "RAFT", "DIS fast", "DIS medium", "RAFT / DIS medium", "all pixels: RAFT", "DIS medium")
CARD = """---
library_name: pytorch
license: apache-2.0
pipeline_tag: image-to-image
tags: [optical-flow, raft]
---

# RAFT-small for clips of moving bodies

RAFT (Teed & Deng, ECCV 2020) in its small size, with the learned convex upsampling of the large one: {parameters:.2f}
million parameters. Load it with `pipeline.vision.flow.raft.load_raft("models/raft-small")`; `flow(frames_a, frames_b)`
takes uint8 RGB and returns px. It is made for a camera at rest, rigid bodies and flows up to about 20 px at 240x160.

## Training

From random weights, by `python -m training.raft` ({pairs:,} pairs in {steps:,} steps{device}), on windows of rendered
pairs with exact flow: neighbouring frames of simulated clips, and 1 to 6 random bodies (spheres, cylinders, boxes,
capsules, ellipsoids; plain or textured) that slide, roll, fly, spin or rest, in front of a random floor and backdrop,
with random lights, cameras, blur, noise and compression; and on textures warped by smooth flows. No recorded video and
no other data set was used. {start}

## Scores

Mean end-point error over the pixels of moving bodies in the first frame, px of the size stated; {iterations}
iterations.

{table}
Measured on pairs of a seed that the training does not use; `python -m benchmarks.flow` measures on fresh pairs. The
clips of another engine (Blender's Cycles and Bullet) were not used for training.

## Limits

The rotation of a body of one colour (a plain rolling ball) does not show; its flow is then a guess from the training
distribution. The training had no moving camera, no deforming bodies and no motions above 30 px.
"""


def write_card(folder: Path, model: RAFT, steps: int, pairs: int) -> None:
    """Write README.md beside the weights; steps, pairs: of the training."""
    sets = {"our ray caster, held out": held_out(SEED)}
    if choose_backend("auto")[0] == "mujoco":
        sets["MuJoCo's renderer, held out"] = held_out(SEED + 1, 100, mujoco=True)
    clips = cross_engine_folder()
    if clips is not None:
        sets["another engine's clips"] = cross_engine(clips)
    estimators: dict[str, Estimator] = {"raft": model, "fast": DIS("fast"), "medium": DIS("medium")}
    rows = [
        row(name, batch, {k: score(e, batch, ITERATIONS) for k, e in estimators.items()})
        for name, batch in sets.items()
    ]
    text = CARD.format(
        parameters=sum(p.numel() for p in model.parameters()) / 1e6,
        pairs=pairs,
        steps=steps,
        start=COLD_START if model.warm_start is None else WARM_START.format(preset=model.warm_start),
        device=", on one CPU core" if not torch.cuda.is_available() else "",
        iterations=ITERATIONS,
        table=markdown(COLUMNS, rows),
    )
    temporary = folder / "README.md.part"
    temporary.write_text(text)
    temporary.replace(folder / "README.md")


def row(name: str, batch: Batch, scores: dict[str, Score]) -> list[str]:
    count, height, width = batch.foreground.shape
    raft, fast, medium = scores["raft"], scores["fast"], scores["medium"]
    bodies = [f"{s.foreground:.3f}" for s in (raft, fast, medium)]
    frame = [f"{s.frame:.4f}" for s in (raft, medium)]
    return [f"{name}: {count} of {width}x{height}", *bodies, f"{raft.foreground / medium.foreground:.2f}", *frame]
