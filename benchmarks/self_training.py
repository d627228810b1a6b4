"""Greedy answers of models of objects, compared clip by clip, on three sets of clips that no model learned from.

    python -m benchmarks.self_training CLIPS models/objects PATH [PATH ...] [--kept FOLDER]

The sets: `look`, the held-out clips of training.objects.other_looks in CLIPS; `engine`, those of another engine
(`cross_engine` in DYNAMICS_DATA or ../shared/data); `id`, fresh clips of the graph (seed SEED). Masks are found by
models/masks, flow is RAFT's. Prints means with 95 % bootstrap intervals, and of each further model the differences to
the first one, clip by clip. FOLDER keeps the scores.
"""

from __future__ import annotations

import argparse
import json
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from pipeline.objects.answering import load_objects, write_scenes
from pipeline.objects.network import ObjectsNetwork
from training.objects.other_looks import read_clip
from training.objects.self_training import held_out

from benchmarks.kept_answers import kept_answers, kept_folder
from benchmarks.mask_clips import data_folder
from benchmarks.measured_objects import MEASURED, kept, measure, measured_clip, suite_scenes
from pipeline.clips.schedule import Schedule
from pipeline.evaluation.scene_scores import Reference, measured_reference, score, true_reference
from pipeline.evaluation.tables import cell, markdown
from pipeline.metrics.intervals import bootstrap_mean
from pipeline.model.instances import Instances, instances_of
from pipeline.model.sampling import Sampling
from pipeline.perception.mask_source import MaskSource
from pipeline.perception.prompts import Prompts
from pipeline.perception.user_clip import read_frames, with_masks
from pipeline.vision.recordings.clip_folder import find_clips, masks_beside
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file

SEED = 11  # of the clips of the set `id`
METRICS = {"iou": "IoU, sequence", "composition": "composition right", "iou_initial": "IoU, first frame"}
RESAMPLES = 10_000


@dataclass(frozen=True)
class Asked:
    """A clip: its set and number, what is seen of it, what answers are compared with, and its true composition."""

    of: str
    clip: int
    shown: Instances
    truth: Callable[[], Reference]
    composition: str


def other_look(folder: Path, schedule: Schedule) -> Iterator[Asked]:
    """The held-out clips of another look."""
    for path in sorted(p for p in folder.glob("*.npz") if held_out(int(p.stem))):
        clip = read_clip(path)
        shown = instances_of(clip.found[schedule.pairs[:, 0]], clip.flow)
        yield Asked(
            "look", int(path.stem), shown, lambda c=clip: true_reference(c.scene, schedule), clip.scene.composition
        )


def another_engine(params: Params) -> Iterator[Asked]:
    """The clips of another engine."""
    schedule = params.clip.schedule
    for k, place in enumerate(p for p in find_clips(data_folder() / "cross_engine") if p.is_dir()):
        read = read_frames(place, seconds=schedule.seconds, fps=schedule.fps, source=MaskSource(masks_beside(place)))
        taken = with_masks(read, Prompts())
        frames, masks, times = taken.clip.frames, taken.masks, np.array(taken.clip.source_times)
        measured = kept(
            MEASURED / f"{params.seed}" / "real" / f"{k:04d}.npz",
            lambda f=frames, m=masks, t=times: measure(f, m, t, schedule, params),
        )
        shapes = sorted(o["type"] for o in json.loads((place / "truth.json").read_text())["objects"])
        yield Asked(
            "engine",
            k,
            measured.instances("found"),
            lambda m=masks, found=measured: measured_reference(m, found.flow_true, schedule.pairs[:, 0]),
            "+".join(shapes),
        )


def of_the_graph(params: Params, clips: int) -> Iterator[Asked]:
    """Fresh clips of the suite `id`."""
    schedule = params.clip.schedule
    for k, scene in enumerate(suite_scenes(params, "id", clips)):
        file = MEASURED / f"{params.seed}" / "id" / f"{k:04d}.npz"
        measured = kept(file, lambda s=scene, clip=k: measured_clip(s, "id", clip, params))
        truth = lambda s=scene: true_reference(s, schedule)  # noqa: E731
        yield Asked("id", k, measured.instances("found"), truth, scene.composition)


def greedy_scores(network: ObjectsNetwork, asked: Asked, truth: Reference, schedule: Schedule) -> dict[str, float]:
    """The metrics of the greedy answer to a clip."""
    if not len(asked.shown):
        return dict.fromkeys(METRICS, 0.0)
    (scene,), _ = write_scenes(network, asked.shown, Sampling(seconds=schedule.seconds), 0)
    found = score(scene, truth, schedule) | {"composition": float(scene.composition == asked.composition)}
    return {name: found[name] for name in METRICS}


def summary(rows: list[dict], models: list[str]) -> str:
    """Means of each model by set, and the differences to the first one, clip by clip."""
    found = {(r["model"], r["set"], r["clip"]): r for r in rows}
    lines = []
    for of in dict.fromkeys(r["set"] for r in rows):
        clips = sorted(k for m, s, k in found if m == models[0] and s == of)
        for model in models:
            own = [k for k in clips if (model, of, k) in found]
            values = {n: np.array([found[model, of, k][n] for k in own]) for n in METRICS}
            first = {n: np.array([found[models[0], of, k][n] for k in own]) for n in METRICS}
            less = [
                cell(bootstrap_mean(values[n] - first[n], RESAMPLES)) if model != models[0] else "" for n in METRICS
            ]
            means = [cell(bootstrap_mean(values[n], RESAMPLES)) for n in METRICS]
            lines.append([of, str(len(own)), model, *means, *less])
    head = ["clips", "n", "model", *METRICS.values(), *(f"difference, {name}" for name in METRICS.values())]
    return markdown(head, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path, help="folder of training.objects.other_looks")
    parser.add_argument("models", nargs="+", help="folders; the first is compared with")
    parser.add_argument("--id", type=int, default=60, help="clips of the set `id`")
    parser.add_argument("--kept", type=Path, help="a folder for the scores; default: a temporary one")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    params = read_params_file(PARAMS_FILE, Params).model_copy(update={"seed": SEED})
    schedule = params.clip.schedule
    networks = {name: load_objects(name, schedule.model_frames).model for name in asked.models}
    marks = {name: zlib.crc32(Path(name, "model.safetensors").read_bytes()) for name in asked.models}
    with kept_folder(asked.kept) as folder:
        path = folder / "scores.jsonl"
        rows = kept_answers(path)
        done = {(r["mark"], r["set"], r["clip"]) for r in rows}
        for clip in (*another_engine(params), *other_look(asked.clips, schedule), *of_the_graph(params, asked.id)):
            waiting = [name for name in asked.models if (marks[name], clip.of, clip.clip) not in done]
            truth = clip.truth() if waiting else None
            for name in waiting:
                assert truth is not None
                head = {"mark": marks[name], "set": clip.of, "clip": clip.clip}
                rows.append({**head, **greedy_scores(networks[name], clip, truth, schedule)})
                with path.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    named = {mark: name for name, mark in marks.items()}
    print(summary([{**r, "model": named[r["mark"]]} for r in rows if r["mark"] in named], asked.models))


if __name__ == "__main__":
    main()
