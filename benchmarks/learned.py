"""Scores of a model's answers before any search: greedy, and the best of K samples by replay.

Asks one model about the clips of a finished graph. In a clone, on fresh clips:

    dvc exp run -S seed=11 -S suites.id.clips=200 -S suites.held_out.clips=48 -S suites.more.clips=48 \\
        -S suites.real.path=CROSS_ENGINE best_of_k@id best_of_k@held_out best_of_k@more best_of_k@real
    python -m benchmarks.learned words [--model models/words] [--samples 32] [--suites id,held_out,more,real]

The name is that of a row in the tables; pairs of rows in COMPARED are compared clip by clip. `--input rgb` shows the
frames instead of RAFT's flow, `--sees frame` whole pictures instead of each body by itself, `--without-reasoning` asks
for the scene only. Bodies are those that the network for masks finds in the frames, with `--true-masks` the true ones,
with the probability of each body's shape by the network for shapes, unless `--without-shape-prior`. A model with a
tokenizer of its own is shown pictures of the flow or the frames. Each answer is appended to
benchmarks/results/learned/answers.jsonl, so that a stopped run can be continued; learned.csv, differences.csv and
learned.md beside it sum them up, and the report shows them. Without a name it only sums up.
"""

from __future__ import annotations

import argparse
import json
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm
from transformers.utils import logging

from benchmarks.kept_answers import kept_answers
from benchmarks.measured_clips import MEASURED, kept, measure
from benchmarks.starts import shapes_of
from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import write_rows
from pipeline.evaluation.scene_scores import METRICS, score
from pipeline.evaluation.suite import Suite, reference
from pipeline.evaluation.summary import Summary, as_csv, best_of_k_curve, summarise
from pipeline.evaluation.tables import (
    ERRORS,
    SAMPLES,
    SCORES,
    differences_table,
    markdown,
    metrics_table,
    samples_table,
)
from pipeline.language.completion import read_completion
from pipeline.metrics.intervals import bootstrap_mean
from pipeline.model.answering import Shown, load_answering, write
from pipeline.model.base import Base
from pipeline.model.patches import resize_frames
from pipeline.model.sampling import Sampling
from pipeline.model.shown import SeenBodies
from pipeline.model.words_model import WordsModel
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.search.best_of_k import rank
from pipeline.search.evaluator import Evaluator
from pipeline.search.target import make_target
from stages.graph.clip_pictures import picture_stage, pictures
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from stages.graph.suite import open_suite

RESULTS = Path("benchmarks/results/learned")
ANSWERS = RESULTS / "answers.jsonl"
SUITES = ("id", "held_out", "more", "real")
COMPARED = (  # first minus second, by clip
    ("words", "words without reasoning"),
    ("words", "words by colours"),
    ("words", "words of frames"),
    ("words", "words without shape prior"),
    ("words", "words with true masks"),
    ("words", "regressor"),
)
RESAMPLES = 10_000


def answers(base: Base | WordsModel, shown: Shown, sampling: Sampling, seed: int) -> tuple[list[Scene], float]:
    """The scenes that the model answers to one clip, and the seconds that it took."""
    began = time.perf_counter()
    (each,) = write(base, [shown], sampling, [seed])
    seconds = time.perf_counter() - began
    return [read_completion(answer.text).scene for answer in each], seconds


def shown_of_clip(
    suite: Suite, label: str, clip: int, asked: argparse.Namespace, params: Params, base: Base | WordsModel
) -> Shown:
    """What the model sees of a clip."""
    schedule = params.clip.schedule
    if isinstance(base, WordsModel):
        rendered = suite["render"][clip]
        times = rendered.row()["recorded"] if label == "real" else schedule.frame_steps / STEPS_PER_SECOND
        frames, masks = rendered.array("rgb"), rendered.array("mask")
        file = MEASURED / f"{params.seed}" / label / f"{clip:04d}.npz"
        measured = kept(file, lambda: measure(frames, masks, np.asarray(times), schedule, params))
        first = frames[schedule.pairs[:, 0]]
        return measured.seen(first, asked.input, asked.sees, asked.true_masks, not asked.without_shape_prior)
    found = pictures(suite[picture_stage(asked.input)][clip], asked.input, schedule)
    return resize_frames(found, base.layout.width, base.layout.height)


def rows_of(
    asked: argparse.Namespace, base: Base | WordsModel, suite: Suite, label: str, clip: int, params: Params
) -> Iterator[dict[str, Any]]:
    """The scores of the greedy answer to a clip, and of the best of the samples."""
    schedule = Schedule(**params.clip.model_dump())
    shown = shown_of_clip(suite, label, clip, asked, params, base)
    truth, shapes = reference(suite, clip, schedule), shapes_of(suite, clip, params)

    def scored(scene: Scene) -> dict[str, float]:
        found = score(scene, truth, schedule)
        if shapes is not None:
            found["composition"] = float(sorted(scene.shapes) == sorted(shapes))
        return found

    how = {
        "reasoning": not asked.without_reasoning,
        "seconds": schedule.seconds,
        "numbers": asked.numbers,
        "middle": params.infer.middle,
    }
    head = {"suite": label, "clip": clip}
    if isinstance(shown, SeenBodies) and not len(shown.instances):  # the network for masks found nothing: no answer
        nothing = {"seconds": 0.0, **dict.fromkeys(("composition", "iou_initial", "iou", "valid"), 0.0)}
        yield {**head, "method": asked.name, "simulations": 0, **nothing}
        if asked.samples:
            yield {**head, "method": f"{asked.name}, best of {asked.samples}", "simulations": asked.samples, **nothing}
        return
    (scene,), seconds = answers(base, shown, Sampling(**how), 0)
    yield {**head, "method": asked.name, "simulations": 0, "seconds": seconds, **scored(scene)}
    if not asked.samples:
        return
    seed = zlib.crc32(f"{params.seed} {label} {clip}".encode())
    sampling = Sampling(asked.samples, asked.temperature, params.infer.top_p, **how)
    scenes, seconds = answers(base, shown, sampling, seed)
    masks = suite["render"][clip].array("mask")[schedule.pairs[:, 0]]
    target = make_target(masks, suite["flow"][clip].array("flow"), params.search.width, params.search.height)
    ranking = rank(Evaluator(target, schedule, threads=1), scenes)
    curve = best_of_k_curve(ranking.rewards.reward, ranking.rewards.iou)
    yield {
        **head,
        "method": f"{asked.name}, best of {asked.samples}",
        "simulations": asked.samples,
        "seconds": seconds,
        **scored(scenes[ranking.order[0]]),
        **{f"iou@{k}": float(curve[k - 1]) for k in SAMPLES if k <= asked.samples},
    }


def ask(asked: argparse.Namespace) -> None:
    """Ask the model about all clips that it has not answered yet."""
    params = read_params_file(PARAMS_FILE, Params)
    base = load_answering(asked.model, params.model.width, params.model.height, params.clip.model_frames)
    done = {(a["suite"], a["clip"], a["method"].split(",")[0]) for a in kept_answers(ANSWERS)}
    RESULTS.mkdir(parents=True, exist_ok=True)
    for label in asked.suites.split(","):
        suite = open_suite(label, ["render", "flow"])
        todo = [c for c in range(len(suite["flow"])) if (label, c, asked.name) not in done]
        if asked.objects is not None:  # of clips whose objects are known
            shapes = {c: shapes_of(suite, c, params) for c in todo}
            todo = [c for c, known in shapes.items() if known is not None and len(known) <= asked.objects]
        for clip in tqdm(todo[: asked.clips], desc=label, unit="clip"):
            rows = list(rows_of(asked, base, suite, label, clip, params))
            with ANSWERS.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)


def differences(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Greedy sequence IoU of both models of each pair in COMPARED, and the difference by clip."""
    found = {(r["method"], r["suite"], r["clip"]): r["iou"] for r in rows}
    out = []
    for first, second in COMPARED:
        for suite in SUITES:
            both = [
                (v, found[second, *key])
                for (m, *key), v in found.items()
                if m == first and key[0] == suite and (second, *key) in found
            ]
            if both:
                a, b = np.array(both).T
                head = {"suite": suite, "first": first, "second": second}
                out += [
                    {**head, "what": what, **bootstrap_mean(values, RESAMPLES).row()}
                    for what, values in (("first", a), ("second", b), ("difference", a - b))
                ]
    return out


def summary_text(summary: Summary, differing: list[dict[str, Any]]) -> str:
    """The text of learned.md."""
    return "\n".join(
        [
            "# The model's answers before any search\n",
            "`python -m benchmarks.learned`: RAFT's flow; means over clips with 95 % bootstrap intervals. seconds: to "
            "write the answers to one clip.\n",
            markdown(*metrics_table(summary, SCORES)),
            "Sequence IoU of the best of K samples by replay, at the size of the search (K drawn of all samples):\n",
            markdown(*samples_table(summary)),
            "Mean absolute errors of parameters over clips whose composition is right:\n",
            markdown(*metrics_table(summary, ERRORS)),
            "Greedy sequence IoU, compared clip by clip:\n",
            markdown(*differences_table(differing)),
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="?", help="of the row; without it, only sum up the answers so far")
    parser.add_argument("--model", default="models/words", help="a folder, or a hub name in the local cache")
    parser.add_argument("--suites", default=",".join(SUITES))
    parser.add_argument("--clips", type=int, default=None, help="of each suite, at most")
    parser.add_argument("--objects", type=int, default=None, help="of a clip, at most")
    parser.add_argument("--samples", type=int, default=32, help="K; 0: greedy alone")
    parser.add_argument("--temperature", type=float, default=read_params_file(PARAMS_FILE, Params).infer.temperature)
    parser.add_argument("--without-reasoning", action="store_true", help="without reasoning")
    parser.add_argument("--numbers", default="quantiles", choices=("quantiles", "tokens"), help="how they are chosen")
    parser.add_argument("--input", default="flow", choices=("flow", "rgb"))
    parser.add_argument("--sees", default="bodies", choices=("bodies", "frame"))
    parser.add_argument("--true-masks", action="store_true", help="in place of those that the network finds")
    parser.add_argument("--without-shape-prior", action="store_true", help="without the network for shapes")
    parser.add_argument("--threads", type=int, default=2)
    asked = parser.parse_args()
    logging.set_verbosity_error()
    torch.set_num_threads(asked.threads)
    if asked.name:
        ask(asked)
    rows = kept_answers(ANSWERS)
    rows.sort(key=lambda r: (SUITES.index(r["suite"]), r["method"]))
    metrics = [*METRICS, *ERRORS, *(f"iou@{k}" for k in SAMPLES)]
    summary = summarise(rows, metrics, RESAMPLES)
    (RESULTS / "learned.csv").write_text(as_csv(summary))
    differing = differences(rows)
    write_rows(RESULTS / "differences.csv", differing, digits=5)
    text = summary_text(summary, differing)
    (RESULTS / "learned.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
