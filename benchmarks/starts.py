"""What the search reaches from which start, at which budget.

Works on the clips of a finished graph: suite `id` (the first --each clips of 1, 2 and 3 objects) and suite `real`, with
given masks, and for `real` also with masks from motion. Each answer is appended to
benchmarks/results/starts/answers.jsonl, so that a stopped run can be continued; starts.csv and starts.md beside it sum
them up, and the report shows them (--results: another folder). In a clone, with fresh clips and 32 samples a clip:

    dvc exp run -S seed=7 -S suites.id.clips=80 -S infer.samples=32 -S suites.real.path=CROSS_ENGINE \\
        best_of_k@id best_of_k@real
    python -m benchmarks.starts [--each 16] [--simulations 12800] [--only guess,given,…] [--workers 2] [--minutes M]

The starts are explained in benchmarks/results/starts/README.md. Rivals: plain CMA-ES (128 a generation), from bestK as
in the paper, and from given.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.kept_answers import answers_of, kept_answers
from benchmarks.motion_masks import masks_from_motion
from pipeline.clips.intervals import bootstrap_mean
from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import write_rows
from pipeline.inference.scene_search import distinct_starts
from pipeline.report.markdown import markdown
from pipeline.report.scene_scores import score
from pipeline.report.suite import Suite, greedy_row, reference
from pipeline.report.tables import starts_table
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.search.cmaes import Budget, cmaes_search
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit_scene import fit_scene
from pipeline.search.guess import guess_scene
from pipeline.search.search_result import SearchRecord, SearchResult
from pipeline.search.search_scene import search_scene
from pipeline.search.target import Target, make_target
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.dis import DIS
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from stages.graph.suite import open_suite
from training.drawn_scenes import drawn_scenes

RESULTS = Path("benchmarks/results/starts")
BUDGETS = (0, 200, 1000, 1280, 3200, 12800)
POPULATION, SIGMA = 128, 0.1
METRICS = ("iou", "iou_initial", "epe", "epe_frame", "composition", "penetration", "valid")
PARTS = ("render", "flow")
MODEL_PARTS = ("infer", "best_of_k")
KINDS = ("given", "guess", "answers", "motion", "given CMA-ES", "bestK", "greedy", "best1", "prior", "bestK CMA-ES")
BY_MODEL = ("answers", "greedy", "best1", "bestK")


def shapes_of(suite: Suite, clip: int, params: Params) -> list[str] | None:
    """The true shapes in the order of the instances; None where they are not known."""
    if "sample" in suite:
        return list(read_scene(suite["sample"][clip].row()["scene"]).shapes)
    folder = Path(params.suites.real.path or ".") / suite["render"][clip].row()["name"]
    if not (folder / "truth.json").is_file():
        return None
    kinds = {o["id"]: o["type"] for o in json.loads((folder / "truth.json").read_text())["objects"]}
    with np.load(folder / "masks.npz") as stored:
        return [kinds[int(i)] for i in np.unique(stored["masks"]) if i]


def start_of(
    kind: str, suite: Suite, clip: int, target: Target, shapes: list[str] | None, params: Params, schedule: Schedule
) -> Scene:
    """The scene from which a search of this kind starts."""
    if kind == "greedy":
        return read_scene(greedy_row(suite, clip)["scene"])
    if kind == "best1":
        return read_scene(next(r for r in suite["infer"][clip].rows() if r["sample"] == 0)["scene"])
    if kind == "bestK":
        return read_scene(suite["best_of_k"][clip].rows()[0]["scene"])
    if kind == "prior":
        return drawn_scenes(params, params.seed, "prior", range(clip, clip + 1), {max(target.instances, 1): 1.0})[0]
    assert shapes is not None
    return guess_scene(target, shapes, schedule.pairs[:, 0] / schedule.fps)


def searched(
    kind: str,
    suite: Suite,
    clip: int,
    target: Target,
    shapes: list[str] | None,
    params: Params,
    schedule: Schedule,
    simulations: int,
) -> SearchResult:
    """The result of a search of this kind."""
    evaluator, rng = Evaluator(target, schedule, threads=1), clip_rng(params.seed, "starts", clip, kind)
    if kind in ("guess", "motion", "answers"):
        rows = suite["best_of_k"][clip].rows() if kind == "answers" else []
        ranked, valid = [read_scene(row["scene"]) for row in rows], [row["valid"] for row in rows]
        starts = distinct_starts(ranked, valid, params.search.starts)
        return search_scene(evaluator, starts, simulations, rng).result
    start = start_of(kind.removesuffix(" CMA-ES"), suite, clip, target, shapes, params, schedule)
    if kind.endswith("CMA-ES"):
        return cmaes_search(evaluator, [start], Budget(POPULATION, simulations // POPULATION, SIGMA), rng)
    return fit_scene(evaluator, SearchRecord(evaluator), [start], simulations, rng)


def target_of(suite: Suite, clip: int, params: Params, schedule: Schedule, motion: bool) -> Target:
    """What the search has to match; motion: with masks from motion instead of given ones."""
    rendered = suite["render"][clip]
    masks = rendered.array("mask")
    if motion:
        frames = rendered.array("rgb")
        masks = masks_from_motion(frames, DIS("medium").flow(frames[:-1], frames[1:]))
    flow = suite["flow"][clip].array("flow")
    return make_target(masks[schedule.pairs[:, 0]], flow, params.search.width, params.search.height)


def answer(job: tuple[str, int, str, int]) -> dict[str, Any]:
    """One clip from one start: the metrics of the best scene after each budget."""
    name, clip, kind, simulations = job
    warnings.simplefilter("ignore")
    params = read_params_file(PARAMS_FILE, Params)
    suite = open_suite(name, [*PARTS, *MODEL_PARTS * kind.startswith(BY_MODEL)])
    schedule = params.clip.schedule
    target = target_of(suite, clip, params, schedule, kind == "motion")
    shapes = shapes_of(suite, clip, params)
    found = searched(kind, suite, clip, target, shapes, params, schedule, simulations)
    truth = reference(suite, clip, schedule)
    out: dict[str, Any] = {
        "suite": name,
        "clip": clip,
        "start": kind,
        "instances": int(truth.masks.max()),
        "simulations": found.simulations,
        "seconds": found.seconds,
    }
    for budget in (b for b in BUDGETS if b <= simulations):
        scene = found.after(budget)
        scores = score(scene, truth, schedule)
        if shapes is not None:
            scores["composition"] = float(sorted(scene.shapes) == sorted(shapes))
        out[str(budget)] = {m: scores[m] for m in METRICS if m in scores}
    return out


def jobs_of(params: Params, each: int, simulations: int, kinds: list[str]) -> list[tuple[str, int, str, int]]:
    """Suite, clip, start and simulations of every search."""
    out = []
    for name in ("id", "real"):
        suite = open_suite(name, PARTS)
        count: dict[int, int] = defaultdict(int)
        for clip in range(len(suite["render"])):
            instances = int(suite["render"][clip].array("mask").max())
            count[instances] += 1
            if name == "id" and count[instances] > each:
                continue
            for kind in kinds:
                if kind != "motion" or name == "real":
                    out.append((name, clip, kind, simulations))
    return out


def summary(answers: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each suite, start, budget and metric: mean, interval, clips."""
    rows = []
    groups: dict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for a in answers:
        groups[a["suite"], KINDS.index(a["start"])].append(a)
    for (suite, kind), some in sorted(groups.items()):
        for budget in BUDGETS:
            for metric in METRICS:
                values = [a[str(budget)][metric] for a in some if metric in a.get(str(budget), {})]
                if values:
                    e = bootstrap_mean(np.array(values), 2000)
                    rows.append(
                        {
                            "suite": suite,
                            "start": KINDS[kind],
                            "simulations": budget,
                            "metric": metric,
                            "mean": e.mean,
                            "low": e.low,
                            "high": e.high,
                            "largest": max(values),
                            "clips": e.n,
                        }
                    )
    return rows


def write_summary(answers: list[dict[str, Any]], folder: Path) -> str:
    """Write starts.csv and starts.md into a folder; return the text of the latter."""
    rows = summary(answers)
    write_rows(folder / "starts.csv", rows, digits=5)
    text = markdown(*starts_table(rows))
    (folder / "starts.md").write_text(text, encoding="utf-8")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=16, help="clips of each number of objects, suite id")
    parser.add_argument("--simulations", type=int, default=12800)
    parser.add_argument("--only", default=",".join(KINDS), help="starts, separated by commas")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to continue")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    arguments = parser.parse_args()
    kinds = [k.strip() for k in arguments.only.split(",")]
    if wrong := [k for k in kinds if k not in KINDS]:
        parser.error(f"--only: unknown start {wrong[0]!r}; valid: {', '.join(KINDS)}")
    arguments.results.mkdir(parents=True, exist_ok=True)
    path = arguments.results / "answers.jsonl"
    answers = kept_answers(path)
    done = {(a["suite"], a["clip"], a["start"]) for a in answers}
    params = read_params_file(PARAMS_FILE, Params)
    waiting = [j for j in jobs_of(params, arguments.each, arguments.simulations, kinds) if j[:3] not in done]
    found = answers_of(answer, waiting, path, arguments.workers, arguments.minutes)
    answers += tqdm(found, total=len(waiting), unit="search")
    print(write_summary(answers, arguments.results))


if __name__ == "__main__":
    main()
