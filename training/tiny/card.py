"""Measure the tiny model and write its model card.

    python -m training.tiny.card [--model models/tiny]

Run `python -m benchmarks.learned tiny` first: the scores on RAFT's flow are taken from benchmarks/results/learned. This
module scores greedy answers on exact flow with the noise of the training, on fresh clips of the suite `id`; a test
scores the shipped weights again on some of these clips.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.csv_rows import read_rows
from pipeline.evaluation.scene_scores import score, true_reference
from pipeline.evaluation.summary import from_csv
from pipeline.language.completion import read_completion
from pipeline.model.base import Base, load_base
from pipeline.model.generate import generate
from pipeline.model.sampling import Sampling
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes
from training.model_card import CHECKED, LEARNED, SUITES, exact_table, table_of
from training.tiny.examples import LAYOUT, ExampleKind, picture
from training.tiny.trainer import LOG

SUITE = "tiny-card"  # names the random streams of the clips
BATCH = 16


def picture_of_clip(params: Params, index: int, scene: Scene) -> np.ndarray:
    """What the model sees of a clip, (T, H, W, 3) uint8."""
    schedule = Schedule(**params.clip.model_dump())
    trace = simulate(scene, schedule.seconds)
    view = pair_view(scene, *trace_pairs(trace, schedule), LAYOUT.width, LAYOUT.height)
    return picture(params, ExampleKind(), SUITE, index, scene, trace, view)


def measure(base: Base, params: Params, clips: int) -> list[dict[str, float]]:
    """Scores of the greedy answers on the first `clips` clips of `SUITE`, of 1 to 3 objects."""
    schedule = Schedule(**params.clip.model_dump())
    rows = []
    for start in tqdm(range(0, clips, BATCH), desc="clips", unit=f"{BATCH} clips", disable=None):
        indices = range(start, min(start + BATCH, clips))
        scenes = drawn_scenes(params, params.seed, SUITE, indices, params.suites.id.objects)
        pictures = np.stack([picture_of_clip(params, i, s) for i, s in zip(indices, scenes, strict=True)])
        greedy = Sampling(reasoning=True, seconds=schedule.seconds)
        for scene, (answer,) in zip(scenes, generate(base, pictures, greedy, list(indices)), strict=True):
            rows.append(score(read_completion(answer.text).scene, true_reference(scene, schedule), schedule))
    return rows


CARD = """---
license: apache-2.0
library_name: transformers
pipeline_tag: video-text-to-text
---

# tiny

A Qwen2.5-VL architecture of {millions:.1f} million parameters with its own tokenizer. It reads the optical flow of a
one-second clip and writes the scene. It ships so that the whole graph runs on a laptop.{places}

**Training.** `python -m training.tiny`, from random weights, on clips that were sampled, simulated and rasterised
during the training (the distribution of params.yaml, 1 to 4 objects, exact flow with noise like RAFT's): {clips:,}
clips in {minutes:.0f} minutes (`log.csv`), on one shared CPU core, in the last 32 minutes on two. Of these,
{fresh_clips:,} were different clips. Another 4,672 clips had RAFT's own flow (`python -m training.tiny.measured`); they
were half of the draws from clip 125,000 on, and three fifths from 134,000 on. Completions without reasoning: a quarter
of the first 92,000 clips, three quarters of the next 33,000, three eighths of the rest. From clip 101,000 on, numbers
had soft targets (`training/tiny/soft_numbers.py`). Loss on held-out clips with RAFT's flow, hard targets: {loss:.3f}
nats a free token.

**Scores** before any search, with RAFT's flow, on fresh clips (`python -m benchmarks.learned tiny`), means with 95 %
bootstrap intervals:

{scores}
{suites}.

Greedy, on {n} fresh clips of 1 to 3 objects with exact flow and the noise of the training
(`python -m training.tiny.card`; a test scores the first {checked} again):

{exact}
**Limits.** {limits} A clip does not determine the absolute scale, nor the mass of a body that touches
nothing movable. The search (`--search`) fits a clip better than any answer of this model.
"""
PLACES = """ The third colour channel of its input
encodes each patch's place and time (`places` in clip_layout.json)."""
LIMITS = (
    "It was trained on few clips: more than half of its answers have a wrong shape or count, and nearly all of those\n"
    "to clips of four or more objects. It does not recognise orientations."
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=Path("models/tiny"))
    parser.add_argument("--clips", type=int, default=96)
    args = parser.parse_args()
    torch.set_num_threads(2)
    params = read_params_file(PARAMS_FILE, Params)
    base = load_base(str(args.model))
    rows = measure(base, params, args.clips)
    log, learned = read_rows(args.model / LOG)[-1], from_csv(read_rows(LEARNED))
    text = CARD.format(
        millions=sum(p.numel() for p in base.model.parameters()) / 1e6,
        places=PLACES if base.layout.places else "",
        clips=int(log["clips"]),
        fresh_clips=int(log["fresh_clips"]),
        minutes=float(log["minutes"]),
        loss=float(log["loss"]),
        scores=table_of(learned, "tiny"),
        suites="; ".join(f"{name}: {what}" for name, what in SUITES.items()),
        n=len(rows),
        checked=CHECKED,
        exact=exact_table(rows),
        limits=LIMITS,
    )
    (args.model / "README.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
