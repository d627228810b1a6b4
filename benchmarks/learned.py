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
benchmarks/results/learned/answers.jsonl, so that a stopped run can be continued; learned.csv, differences.csv,
learned.md and events.md beside it sum them up, and the report shows them. Without a name it only sums up.
"""

from __future__ import annotations

import argparse
import json
import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm
from transformers.utils import logging

from benchmarks.kept_answers import kept_answers
from benchmarks.measured_clips import MEASURED, kept, measure
from benchmarks.starts import shapes_of
from pipeline.clips.events import Thresholds, event_of_row
from pipeline.clips.intervals import MeanInterval, bootstrap_mean, bootstrap_ratio, bootstrap_ratio_difference
from pipeline.csv_rows import write_rows
from pipeline.model.answering import Shown, load_answering, write
from pipeline.model.base import Base
from pipeline.model.language.completion import read_completion
from pipeline.model.patches import resize_frames
from pipeline.model.sampling import Sampling
from pipeline.model.shown import SeenBodies
from pipeline.model.words_model import WordsModel
from pipeline.report.event_scores import EVENT_METRICS, KIND_METRICS, SAID, SIMULATED, score_events
from pipeline.report.event_table import EVENTS, events_table
from pipeline.report.markdown import markdown
from pipeline.report.scene_scores import METRICS, score_with_pairs
from pipeline.report.suite import Suite, reference
from pipeline.report.summary import COUNTS, Summary, as_csv, best_of_k_curve, summarise, with_metrics
from pipeline.report.tables import (
    ERRORS,
    SAMPLES,
    SCORES,
    differences_table,
    metrics_table,
    samples_table,
)
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


def answers(base: Base | WordsModel, shown: Shown, sampling: Sampling, seed: int) -> tuple[list[str], float]:
    """The texts that the model answers to one clip, and the seconds that it took."""
    began = time.perf_counter()
    (each,) = write(base, [shown], sampling, [seed])
    return [answer.text for answer in each], time.perf_counter() - began


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
    schedule = params.clip.schedule
    shown = shown_of_clip(suite, label, clip, asked, params, base)
    truth, shapes = reference(suite, clip, schedule), shapes_of(suite, clip, params)
    true_events = [event_of_row(row) for row in suite["events"][clip].rows("events")] if "events" in suite else None
    thresholds = Thresholds(**params.events.model_dump(), visible_px=params.sample.filters.visible_px)

    def scored(text: str) -> dict[str, float]:
        scene = read_completion(text).scene
        scores = score_with_pairs(scene, truth, schedule)
        found = dict(scores.metrics)
        if shapes is not None:
            found["composition"] = float(sorted(scene.shapes) == sorted(shapes))
        if true_events is not None:
            found |= score_events(scene, scores.pairs, text, true_events, schedule, thresholds)
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
    (text,), seconds = answers(base, shown, Sampling(**how), 0)
    yield {**head, "method": asked.name, "simulations": 0, "seconds": seconds, **scored(text)}
    if not asked.samples:
        return
    seed = zlib.crc32(f"{params.seed} {label} {clip}".encode())
    sampling = Sampling(asked.samples, asked.temperature, params.infer.top_p, **how)
    texts, seconds = answers(base, shown, sampling, seed)
    masks = suite["render"][clip].array("mask")[schedule.pairs[:, 0]]
    target = make_target(masks, suite["flow"][clip].array("flow"), params.search.width, params.search.height)
    ranking = rank(Evaluator(target, schedule, threads=1), [read_completion(text).scene for text in texts])
    curve = best_of_k_curve(ranking.rewards.reward, ranking.rewards.iou)
    yield {
        **head,
        "method": f"{asked.name}, best of {asked.samples}",
        "simulations": asked.samples,
        "seconds": seconds,
        **scored(texts[ranking.order[0]]),
        **{f"iou@{k}": float(curve[k - 1]) for k in SAMPLES if k <= asked.samples},
    }


def ask(asked: argparse.Namespace) -> None:
    """Ask the model about all clips that it has not answered yet."""
    params = read_params_file(PARAMS_FILE, Params)
    base = load_answering(asked.model, params.model.width, params.model.height, params.clip.model_frames)
    done = {(a["suite"], a["clip"], a["method"].split(",")[0]) for a in kept_answers(ANSWERS)}
    RESULTS.mkdir(parents=True, exist_ok=True)
    for label in asked.suites.split(","):
        suite = open_suite(label, ["render", "flow", *["events"] * (label != "real")])
        todo = [c for c in range(len(suite["flow"])) if (label, c, asked.name) not in done]
        if asked.objects is not None:  # of clips whose objects are known
            shapes = {c: shapes_of(suite, c, params) for c in todo}
            todo = [c for c, known in shapes.items() if known is not None and len(known) <= asked.objects]
        for clip in tqdm(todo[: asked.clips], desc=label, unit="clip"):
            rows = list(rows_of(asked, base, suite, label, clip, params))
            with ANSWERS.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)


def differences(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Greedy scores of both models of each pair in COMPARED, and the difference by clip."""
    found = {(r["method"], r["suite"], r["clip"]): r for r in rows}
    out = []
    for first, second in COMPARED:
        for suite in SUITES:
            both = [
                (r, found[second, *key])
                for (m, *key), r in found.items()
                if m == first and key[0] == suite and (second, *key) in found
            ]
            if both:
                head = {"suite": suite, "first": first, "second": second}
                out += [{**head, **row} for row in _compared(*zip(*both, strict=True))]
    return out


def _compared(first: Sequence[dict[str, Any]], second: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The scores of two models on the same clips, and the difference."""
    for metric in ("composition", "iou"):
        a, b = (np.array([r.get(metric, np.nan) for r in rows], float) for rows in (first, second))
        intervals = [bootstrap_mean(values, RESAMPLES) for values in (a, b, a - b)]
        yield from _rows_of_metric(metric, intervals)
    for metric in (SAID, SIMULATED):
        counts = [[[r.get(f"{metric}.{c}", np.nan) for c in COUNTS] for r in rows] for rows in (first, second)]
        one, other = ((2 * n[:, 0], n[:, 1] + n[:, 2]) for n in np.array(counts, float))
        intervals = [bootstrap_ratio(*one, RESAMPLES), bootstrap_ratio(*other, RESAMPLES)]
        intervals.append(bootstrap_ratio_difference(one, other, RESAMPLES))
        if intervals[-1].n:
            yield from _rows_of_metric(metric, intervals)


def _rows_of_metric(metric: str, intervals: Sequence[MeanInterval]) -> Iterator[dict[str, Any]]:
    for what, interval in zip(("first", "second", "difference"), intervals, strict=True):
        yield {"metric": metric, "what": what, **interval.row()}


def summary_text(summary: Summary, differing: list[dict[str, Any]]) -> str:
    """The text of learned.md."""
    return "\n".join(
        [
            "# The model's answers before any search\n",
            "`python -m benchmarks.learned`: RAFT's flow; means over clips with 95 % bootstrap intervals. seconds: to "
            "write the answers to one clip.\n",
            markdown(*metrics_table(summary, {**SCORES, **EVENTS})),
            "Sequence IoU of the best of K samples by replay, at the size of the search (K drawn of all samples):\n",
            markdown(*samples_table(summary)),
            "Mean absolute errors of parameters over clips whose composition is right:\n",
            markdown(*metrics_table(summary, ERRORS)),
            "Greedy answers, compared clip by clip:\n",
            markdown(*differences_table(differing, {**SCORES, **EVENTS})),
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
    event_metrics = [*EVENT_METRICS, *KIND_METRICS]
    both = summarise(rows, metrics, RESAMPLES, 0, event_metrics)
    summary = with_metrics(both, [*metrics, *EVENT_METRICS])
    (RESULTS / "learned.csv").write_text(as_csv(summary))
    (RESULTS / "events.md").write_text(markdown(*events_table(with_metrics(both, event_metrics))), encoding="utf-8")
    differing = differences(rows)
    write_rows(RESULTS / "differences.csv", differing, digits=5)
    text = summary_text(summary, differing)
    (RESULTS / "learned.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
