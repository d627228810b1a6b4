"""Preference optimisation on another engine's clips: scores of greedy answers to unseen clips, before and after.

    python -m benchmarks.prefer [--model models/words] [--samples 12] [--steps 30] [--seeds 1]

Two folds: the model is optimised on one half of the clips, without their labels, and answers the other half, and vice
versa, so that each clip is answered by a model that was not optimised on it. Masks are given, flow is RAFT's, all other
settings are those of params.yaml. Reads the folder `cross_engine` (in DYNAMICS_DATA, else ../shared/data). Writes
benchmarks/results/prefer.md. Intermediate results are kept in --work, so that a stopped run can be continued.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from transformers.utils import logging

from pipeline.bodies.mask_source import MaskSource
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import read_frames, with_masks
from pipeline.clips.intervals import bootstrap_mean
from pipeline.clips.schedule import Schedule
from pipeline.inference.asking import input_of
from pipeline.inference.model_pictures import shown_clip
from pipeline.model.answering import Shown, load_answering
from pipeline.model.base import Base
from pipeline.model.language.completion import read_completion
from pipeline.model.preference import Pair, draw_answers, pairs_of, prefer, weighted_reward
from pipeline.model.sampling import Completed, Sampling
from pipeline.model.training_plan import TrainingPlan
from pipeline.model.words_model import WordsModel
from pipeline.report.markdown import markdown
from pipeline.report.scene_scores import measured_reference, score
from pipeline.report.tables import cell
from pipeline.search.best_of_k import rank
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.search.target import make_target
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import load_raft
from pipeline.vision.recordings.clip_folder import find_clips, masks_beside
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.data_folder import needed

METRICS = {
    "iou": "IoU, sequence",
    "iou_initial": "IoU, first frame",
    "epe_frame": "EPE, whole frame",
    "composition": "composition",
}
FOLDS = 2
RESAMPLES = 10_000


@dataclass(frozen=True)
class LabelledClip:
    """A clip and its true composition.

    Attributes:
        masks: (T, H, W) uint8.
        flow: (P, H, W, 2) px, measured.
        shown: What the model sees.
        composition: True shapes, as box+sphere.
    """

    masks: np.ndarray
    flow: np.ndarray
    shown: Shown
    composition: str


def kept_json(path: Path, make: Callable[[], Any]) -> Any:
    """The JSON in a file; where it is missing, made now and written."""
    if not path.is_file():
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(make()))
        partial.replace(path)
    return json.loads(path.read_text())


def read_clips(
    folder: Path, params: Params, schedule: Schedule, model: Base | WordsModel, work: Path
) -> list[LabelledClip]:
    """The clips of a folder, with RAFT's flow, which is kept in `work`."""
    raft, f, interval = load_raft(params.flow.raft), params.flow, 1 / schedule.fps
    clips = []
    for place in find_clips(folder):
        read = read_frames(place, seconds=schedule.seconds, source=MaskSource(masks_beside(place)))
        taken = with_masks(read, Prompts())
        file = work / f"{place.name}.flow.npy"
        if not file.is_file():
            recorded = np.array(taken.clip.source_times)
            np.save(
                file,
                measured_flow(
                    raft, taken.clip.frames, recorded, schedule.pairs, interval, f.iterations, (f.width, f.height)
                ),
            )
        flow = np.load(file)
        first = schedule.pairs[:, 0]
        shown = shown_clip(model, input_of(model), flow, taken.clip.frames[first], taken.masks[first], interval)
        shapes = sorted(o["type"] for o in json.loads((place / "truth.json").read_text())["objects"])
        clips.append(LabelledClip(taken.masks, flow, shown, "+".join(shapes)))
    return clips


def greedy_scores(
    base: Base | WordsModel, clips: Sequence[LabelledClip], which: Sequence[int], params: Params
) -> list[dict]:
    """The metrics of the greedy answers to some of the clips."""
    schedule = params.clip.schedule
    greedy = Sampling(reasoning=params.model.reasoning, seconds=schedule.seconds)
    shown = {c: clips[c].shown for c in which}
    answers = draw_answers(base, shown, greedy, dict.fromkeys(which, 0), params.infer.decode_batch_size)
    rows = []
    for c in which:
        scene = read_completion(answers[c][0].text).scene
        truth = measured_reference(clips[c].masks, clips[c].flow, schedule.pairs[:, 0])
        found = score(scene, truth, schedule)
        found["composition"] = float(scene.composition == clips[c].composition)
        rows.append({m: found[m] for m in METRICS})
    return rows


def table(before: list[dict], after: list[list[dict]]) -> str:
    """Means before and after and differences by clip, averaged over seeds, with 95 % bootstrap intervals."""

    def interval(values: np.ndarray) -> str:
        return cell(bootstrap_mean(values, RESAMPLES))

    rows = []
    for metric, heading in METRICS.items():
        old = np.array([row[metric] for row in before])
        new = np.mean([[row[metric] for row in seed] for seed in after], axis=0)
        rows.append([heading, interval(old), interval(new), interval(new - old)])
    return markdown(["greedy answer", "before", "after", "difference"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    own = read_params_file(PARAMS_FILE, Params).prefer
    parser.add_argument("--model", default="models/words", help="a folder")
    for name in (
        "samples",
        "temperature",
        "top_p",
        "epe_weight",
        "margin",
        "pairs",
        "beta",
        "steps",
        "batch_size",
        "learning_rate",
    ):
        value = getattr(own, name)
        parser.add_argument(f"--{name.replace('_', '-')}", type=type(value), default=value)
    parser.add_argument("--seeds", type=int, default=1, help="of the optimisation; their scores are averaged by clip")
    parser.add_argument("--work", type=Path, default=Path(".train/prefer"))
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/prefer.md"))
    a = parser.parse_args()
    folder = needed("cross_engine")
    logging.set_verbosity_error()
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", "2")))
    a.work.mkdir(parents=True, exist_ok=True)
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    base = load_answering(a.model, frames=schedule.model_frames)
    began = time.perf_counter()
    clips = read_clips(folder, params, schedule, base, a.work)
    everything = range(len(clips))
    sampling = Sampling(
        samples=a.samples,
        temperature=a.temperature,
        top_p=a.top_p,
        reasoning=params.model.reasoning,
        seconds=schedule.seconds,
        numbers="tokens",
    )

    def note(text: str) -> None:
        print(f"{time.perf_counter() - began:6.0f} s  {text}", flush=True)

    def drawn(clip: int) -> dict[str, list]:
        seed = zlib.crc32(f"{params.seed} prefer cross_engine {clip}".encode())
        shown, seeds = {clip: clips[clip].shown}, {clip: seed}
        (answers,) = draw_answers(base, shown, sampling, seeds, own.decode_batch_size).values()
        masks = clips[clip].masks[schedule.pairs[:, 0]]
        target = make_target(masks, clips[clip].flow, params.search.width, params.search.height)
        scenes = [read_completion(answer.text).scene for answer in answers]
        rewards = rank(Evaluator(target, schedule, threads=1), scenes).rewards
        note(f"clip {clip}: {a.samples} answers")
        return {
            "answers": [asdict(answer) for answer in answers],
            **{name: column.tolist() for name, column in asdict(rewards).items()},
        }

    def paired(clip: int) -> list[Pair]:
        found = kept_json(a.work / f"{named}-{clip}.json", lambda: drawn(clip))
        answers = [Completed.read(row) for row in found.pop("answers")]
        rewards = Rewards(**{name: np.array(column) for name, column in found.items()})
        return pairs_of(clip, answers, weighted_reward(rewards, a.epe_weight).tolist(), a.margin, a.pairs)

    note(f"{len(clips)} clips")
    named = f"{zlib.crc32(Path(a.model, 'model.safetensors').read_bytes()):08x}"
    before = kept_json(a.work / f"{named}-before.json", lambda: greedy_scores(base, clips, everything, params))
    note(f"greedy sequence IoU before: {np.mean([row['iou'] for row in before]):.4f}")
    named += f"-{a.samples}-{a.temperature}-{a.top_p}"
    pairs = {clip: paired(clip) for clip in everything}
    note(f"{sum(map(len, pairs.values()))} pairs")

    named += f"-{a.epe_weight}-{a.margin}-{a.pairs}-{a.beta}-{a.steps}-{a.batch_size}-{a.learning_rate}"

    def answered(used: list[int], held_out: list[int], seed: int, scratch: Path) -> list[dict]:
        tuned = load_answering(a.model, frames=schedule.model_frames)
        plan = TrainingPlan(
            steps=a.steps,
            epochs=1.0,
            batch_size=a.batch_size,
            learning_rate=a.learning_rate,
            lora_rank=0,
            checkpoint_steps=own.checkpoint_steps,
            seed=seed,
        )
        prefer(
            tuned,
            [p for c in used for p in pairs[c]],
            {c: clips[c].shown for c in used},
            a.beta,
            sampling,
            plan,
            scratch,
            lambda row: note(str({k: row[k] for k in ("step", "loss", "accuracy", "margin") if k in row})),
        )
        return greedy_scores(tuned, clips, held_out, params)

    after: list[list[dict]] = []
    for seed in range(a.seeds):
        order = np.random.default_rng(seed).permutation(len(clips))
        scores: dict[int, dict] = {}
        for fold in range(FOLDS):
            held_out = sorted(order[fold::FOLDS].tolist())
            used = [c for c in everything if c not in held_out]
            name = f"{named}-seed{seed}-fold{fold}"
            rows = kept_json(a.work / f"{name}.json", lambda: answered(used, held_out, seed, a.work / name))  # noqa: B023
            scores |= dict(zip(held_out, rows, strict=True))
            note(
                f"seed {seed}, fold {fold}: sequence IoU {np.mean([before[c]['iou'] for c in held_out]):.4f} -> "
                f"{np.mean([row['iou'] for row in rows]):.4f}"
            )
        after.append([scores[c] for c in everything])
    text = table(before, after)
    settings = ", ".join(f"{k} {v:g}" for k, v in vars(a).items() if isinstance(v, int | float))
    a.out.parent.mkdir(parents=True, exist_ok=True)
    a.out.write_text(
        f"# Preference optimisation on another engine's clips\n\n`python -m benchmarks.prefer`: {a.model}, "
        f"{len(clips)} clips in two folds, each answered by a model optimised on the other fold, without labels; "
        f"{settings}. Means over clips with 95 % bootstrap intervals; differences by clip.\n\n{text}",
        encoding="utf-8",
    )
    print(text)


if __name__ == "__main__":
    main()
