"""Fine-tune the model of objects on clips of another look, with the labels of the search mixed with usual examples.

    python -m training.objects.other_looks CLIPS
    python -m training.objects.shards EXAMPLES --clips 4000 --suite objects-self-training
    python -m training.objects.self_training CLIPS EXAMPLES --out PATH [--labels true] [--least-reward 0.5]

Clips whose label has a smaller reward than --least-reward are left out. Every fourth clip is never learned from
(`held_out`). With --labels true the true scenes are the labels, which is what the search's labels could reach at best.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from pipeline.clips.schedule import Schedule
from pipeline.metrics.overlap import assign, count, pair_iou
from pipeline.objects.answering import load_objects
from pipeline.objects.batch import Group, groups_of, joined, mirrored
from pipeline.objects.example import Example, example_of
from pipeline.scene.canonical import canonical_object
from pipeline.scene.scene import Scene
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.objects.examples import poses_of
from training.objects.other_looks import LabelledClip, read_clip
from training.objects.trainer import Pool, Trainer

HELD_OUT = 4  # every so many clips one is never learned from
LEAST_IOU = 0.2  # of an instance and a true body, mean over the clip's frames; below it the instance is no body
WARM_STEPS, LOG_STEPS = 20, 50


def held_out(clip: int) -> bool:
    """Whether a clip of another look is never learned from."""
    return clip % HELD_OUT == HELD_OUT - 1


def true_pairs(clip: LabelledClip) -> np.ndarray:
    """(K, 2) Which true object is which instance that was found."""
    objects, instances = len(clip.scene.objects), int(clip.found.max(initial=0))
    iou = pair_iou(count(clip.true, clip.found, objects, instances))  # (F, N, M)
    mean = np.nansum(iou, 0) / np.maximum((~np.isnan(iou)).sum(0), 1)
    return np.array([(i, j) for i, j in assign(iou) if mean[i, j] >= LEAST_IOU], int).reshape(-1, 2)


def example_of_clip(clip: LabelledClip, scene: Scene, pairs: np.ndarray, schedule: Schedule) -> Example:
    """A clip of another look as an example.

    Args:
        clip: What was measured.
        scene: Its label.
        pairs: (K, 2) Which object of the label is which instance that was found.
        schedule: Which moments are frames.
    """
    scene = replace(scene, objects=tuple(canonical_object(o) for o in scene.objects))
    found = clip.found[schedule.pairs[:, 0]]
    number = np.zeros(int(clip.found.max(initial=0)) + 1, np.uint8)  # as the label's objects; else after them
    number[pairs[:, 1] + 1] = pairs[:, 0] + 1
    others = np.flatnonzero(number[1:] == 0) + 1
    number[others] = len(scene.objects) + 1 + np.arange(len(others))
    return example_of(scene, number[found], clip.flow, poses_of([scene], schedule)[0], schedule, None)


def examples_of_clips(
    clips: Sequence[LabelledClip], labels: str, least_reward: float, schedule: Schedule
) -> list[Example]:
    """The examples of the clips whose labels are good enough; labels: "search" or "true"."""
    kept = [c for c in clips if c.reward >= least_reward]
    if labels == "true":
        return [example_of_clip(c, c.scene, true_pairs(c), schedule) for c in kept]
    return [example_of_clip(c, c.label, c.pairs, schedule) for c in kept]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path, help="folder of training.objects.other_looks")
    parser.add_argument("examples", type=Path, help="folder of training.objects.shards")
    parser.add_argument("--model", default="models/objects", help="where the training starts")
    parser.add_argument("--out", type=Path, required=True, help="where the model is written")
    parser.add_argument("--labels", default="search", choices=("search", "true"))
    parser.add_argument("--least-reward", type=float, default=0.5)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--share", type=float, default=0.5, help="of a batch that are clips of another look")
    parser.add_argument("--rate", type=float, default=3e-5, help="peak, of AdamW")
    parser.add_argument("--muon-rate", type=float, default=8e-5, help="peak, of Muon")
    parser.add_argument("--files", type=int, default=16, help="of usual examples in memory, 25 MB each")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(asked.seed)
    schedule, rng = read_params_file(PARAMS_FILE, Params).clip.schedule, np.random.default_rng(asked.seed)
    paths = [p for p in sorted(asked.clips.glob("*.npz")) if not held_out(int(p.stem))]
    clips = joined(examples_of_clips([read_clip(p) for p in paths], asked.labels, asked.least_reward, schedule))
    print(f"{len(clips.count)} of {len(paths)} clips are learned from", flush=True)
    model = load_objects(asked.model, schedule.model_frames)
    trainer, pool = Trainer(model.model.train(), asked.rate, asked.muon_rate), Pool(asked.examples, asked.files, 2.0)
    other = round(asked.share * asked.batch)
    sums: dict[str, float] = {}

    def drawn() -> list[Group]:
        some = rng.choice(len(clips.count), other, replace=False)
        turned = rng.random() < 0.5
        groups = [mirrored(g) if turned else g for g in groups_of(clips, some)]
        return groups + (pool.draw(asked.batch - other, rng) if other < asked.batch else [])

    for step in range(asked.steps):
        pool.refresh()
        share = min(1.0, (step + 1) / WARM_STEPS) * (1 - step / asked.steps)
        for name, value in trainer.learn(drawn(), share, rng).items():
            sums[name] = sums.get(name, 0.0) + value / LOG_STEPS
        if trainer.step % LOG_STEPS == 0:
            print({"step": trainer.step, **{k: round(v, 3) for k, v in sums.items()}}, flush=True)
            sums = {}
    trainer.network.load_state_dict(trainer.averaged)
    model.save(asked.out)
    print(f"saved to {asked.out}", flush=True)


if __name__ == "__main__":
    main()
