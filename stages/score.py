"""Score every answer of every suite, and write the report.

Reads data/{sample,render,flow,infer,best_of_k,cmaes}/<suite> and data/finetune. Writes reports/: scores.json (metrics),
scores.csv, scores.md, parameters.md, clips.csv (a row per clip and method), plots/*.csv (plots), index.html.
Parameters: seed, clip, score, search, and for the page's head model, flow.source. Run: python -m stages.score
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.evaluation.best_of_curve import best_of_curve
from pipeline.evaluation.figures import bars, curves, png
from pipeline.evaluation.gallery import clip_picture
from pipeline.evaluation.report import Section, drawing, folded, html_table, page, picture
from pipeline.evaluation.scene_scores import HEIGHT, METRICS, WIDTH, Reference, score, true_reference
from pipeline.evaluation.tables import Summary, as_csv, as_json, markdown, summarise, table
from pipeline.scene.text import read_scene
from pipeline.search.target import make_target
from pipeline.shards.dataset import Clip, ShardedDataset, open_shards
from pipeline.shards.output_errors import writing_to
from stages.main import run
from stages.params import Params, load
from stages.run_shards import DATA, folder

REPORTS = Path("reports")
SUITES = ("id", "held_out", "more", "real")
COLUMNS = {
    "composition": "composition",
    "iou_initial": "IoU, first frame",
    "iou": "IoU, sequence",
    "foreground_iou": "IoU, foreground",
    "epe_first": "EPE, first pair",
    "epe": "EPE, foreground",
    "epe_frame": "EPE, whole frame",
    "penetration": "penetration, m",
}
PARAMETERS = ("camera_height", "camera_pitch", "fov", "gravity", "size", "position", "velocity", "angular_velocity",
              "orientation", "mass", "sliding_friction", "rolling_friction", "damping")  # fmt: skip
UNITS = {"camera_height": "m", "camera_pitch": "deg", "fov": "deg", "gravity": "m/s²", "size": "m", "position": "m",
         "velocity": "m/s", "angular_velocity": "rad/s", "orientation": "deg", "mass": "kg", "rolling_friction": "m"}  # fmt: skip


def reference(suite: str, stages: dict[str, ShardedDataset], clip: int, schedule: Schedule) -> Reference:
    """A sampled clip's own exact replay; for a real clip the masks and the flow that were measured."""
    if suite != "real":
        return true_reference(read_scene(stages["sample"][clip].row()["scene"]), schedule)
    masks, flow = stages["render"][clip].array("mask"), stages["flow"][clip].array("flow")
    scaled = make_target(masks, flow, WIDTH, HEIGHT)
    return Reference(scaled.masks, scaled.flow, schedule.pairs[:, 0])


def answers(stages: dict[str, ShardedDataset], clip: int) -> dict[str, tuple[str, int]]:
    """By method: the answer's scene text and what it cost in simulations."""
    greedy = next(r for r in stages["infer"][clip].rows() if r["sample"] < 0)
    ranked, searched = stages["best_of_k"][clip].rows(), stages["cmaes"][clip].row()
    return {
        "greedy": (greedy["scene"], 0),
        f"best@{len(ranked)}": (ranked[0]["scene"], len(ranked)),
        "cmaes": (searched["scene"], len(ranked) + searched["simulations"]),
    }


def open_suite(suite: str) -> dict[str, ShardedDataset]:
    names = ["render", "flow", "infer", "best_of_k", "cmaes"] + ["sample"] * (suite != "real")
    return {name: open_shards(folder(name, suite)) for name in names}


def score_suite(suite: str, stages: dict[str, ShardedDataset], schedule: Schedule) -> list[dict[str, Any]]:
    rows = []
    for clip in tqdm(range(len(stages["infer"])), desc=f"score {suite}", unit="clip", disable=None):
        truth = reference(suite, stages, clip, schedule)
        for method, (scene, cost) in answers(stages, clip).items():
            rows.append({"suite": suite, "clip": clip, "method": method, "simulations": cost,
                         **score(read_scene(scene), truth, schedule)})  # fmt: skip
    return rows


def plot_rows(suite: str, stages: dict[str, ShardedDataset]) -> dict[str, list[dict[str, Any]]]:
    """What more samples and more iterations buy, means over clips: rows of plots/best_of_k.csv and plots/cmaes.csv."""
    clips: list[Clip] = list(stages["best_of_k"])
    if not clips:
        return {"best_of_k": [], "cmaes": []}
    best = [best_of_curve(np.array([r["reward"] for r in c.rows()]), np.array([r["iou"] for r in c.rows()])) for c in clips]
    history = [c.row()["history"] for c in stages["cmaes"]]
    return {
        "best_of_k": [{"suite": suite, "k": k + 1, "iou": float(v)} for k, v in enumerate(np.mean(best, 0))],
        "cmaes": [{"suite": suite, "iteration": i + 1, "reward": float(v)} for i, v in enumerate(np.mean(history, 0))],
    }


def gallery(suite: str, stages: dict[str, ShardedDataset], count: int, schedule: Schedule) -> list[tuple[str, str, str]]:
    """Figure, caption and think text of the first clips of a suite."""
    out = []
    for clip in range(min(count, len(stages["infer"]))):
        shown = stages["render"][clip]
        scenes = {name: read_scene(text) for name, (text, _) in answers(stages, clip).items()}
        image = clip_picture(shown.array("rgb"), shown.array("mask"), stages["flow"][clip].array("flow"), scenes, schedule)
        name = shown.row()["name"] if suite == "real" else str(clip)
        greedy = next(r for r in stages["infer"][clip].rows() if r["sample"] < 0)
        out.append((picture(png(image), f"{suite}/{name}"), greedy["text"], answers(stages, clip)["cmaes"][0]))
    return out


def write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    names = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def read_curve(path: Path) -> tuple[list[float], list[float]]:
    rows = list(csv.reader(path.open()))[1:]
    return [float(r[0]) for r in rows], [float(r[1]) for r in rows]


def sections(summary: Summary, plots: dict[str, list[dict[str, Any]]], suites: dict[str, dict[str, ShardedDataset]],
             params: Params, schedule: Schedule) -> list[Section]:  # fmt: skip
    scores, errors = table(summary, COLUMNS), table(summary, {f"error.{p}": f"{p}, {UNITS.get(p, '-')}" for p in PARAMETERS})
    names = [s for s in SUITES if suites[s]["infer"]]

    def lines(kind: str, x: str, y: str) -> dict[str, tuple[list[float], list[float]]]:
        rows = plots[kind]
        return {s: ([r[x] for r in rows if r["suite"] == s], [r[y] for r in rows if r["suite"] == s]) for s in names}

    training = {"train": read_curve(DATA / "finetune/loss.csv"), "validation": read_curve(DATA / "finetune/eval_loss.csv")}
    figures = [
        drawing(bars(summary, "iou", "sequence IoU"), "Sequence IoU by suite and method, with 95 % intervals."),
        drawing(curves(lines("best_of_k", "k", "iou"), "k", "IoU"), "Expected IoU of the best of k samples, at the search's size."),
        drawing(curves(lines("cmaes", "iteration", "reward"), "iteration", "reward"), "Best reward (IoU − EPE) so far in CMA-ES."),
        drawing(curves(training, "step", "loss, nats a token"), "Fine-tuning."),
    ]
    out = [
        Section("Scores", "Means with 95 % bootstrap intervals over clips, at 480×320. Sampled suites are compared with their "
                "exact masks and flow in all frames; `real` with its given masks, and with estimated flow in the model's "
                "ten pairs. Simulations: the search's budget a clip.", html_table(*scores)),
        Section("Curves", "", f'<div class="row">{"".join(figures)}</div>'),
        Section("Parameter errors", "Mean absolute errors over clips whose composition is right. The mass of a body that "
                "touches nothing movable, and the absolute scale, are not determined by a clip.", html_table(*errors)),
    ]  # fmt: skip
    for suite in names:
        shown = gallery(suite, suites[suite], params.score.gallery, schedule)
        body = "".join(image + folded("what the model wrote (greedy)", text) + folded("the scene after the search", scene)
                       for image, text, scene in shown)  # fmt: skip
        out.append(Section(f"Clips of {suite}", "The first clips of the suite, not chosen.", body))
    return out


def main() -> None:
    params = load("score")
    schedule = Schedule(**params.clip.model_dump())
    suites = {suite: open_suite(suite) for suite in SUITES}
    rows = [row for suite in SUITES for row in score_suite(suite, suites[suite], schedule)]
    metrics = [*METRICS, *(f"error.{p}" for p in PARAMETERS)]
    summary = summarise(rows, metrics, params.score.bootstrap, np.random.default_rng(params.seed))
    each = [plot_rows(suite, suites[suite]) for suite in SUITES]
    plots = {kind: [row for part in each for row in part[kind]] for kind in ("best_of_k", "cmaes")}
    m = params.model
    facts = {
        "model": m.base, "input": m.input, "reasoning": str(m.reasoning), "flow": params.flow.source,
        "clips": ", ".join(f"{s} {len(suites[s]['infer'])}" for s in SUITES),
        "answers that parse": f"{sum(len(c.rows()) for s in SUITES for c in suites[s]['infer'])} of as many (by grammar)",
    }  # fmt: skip
    lead = ("Every clip is answered by the model with a scene, MuJoCo replays it, and the replay is compared with the clip: "
            "greedy, the best of K samples by replay, and after CMA-ES from the best samples.")  # fmt: skip
    with writing_to(REPORTS):
        write_rows(REPORTS / "clips.csv", rows)
        for kind, table_rows in plots.items():
            write_rows(REPORTS / "plots" / f"{kind}.csv", table_rows)
        (REPORTS / "scores.json").write_text(json.dumps(as_json(summary), indent=1) + "\n")
        (REPORTS / "scores.csv").write_text(as_csv(summary))
        (REPORTS / "scores.md").write_text(markdown(*table(summary, COLUMNS)))
        errors = {f"error.{p}": f"{p}, {UNITS.get(p, '-')}" for p in PARAMETERS}
        (REPORTS / "parameters.md").write_text(markdown(*table(summary, errors)))
        text = page("Video in, physics out: the scores", lead, facts, sections(summary, plots, suites, params, schedule))
        (REPORTS / "index.html").write_text(text, encoding="utf-8")
    print(markdown(*table(summary, {k: COLUMNS[k] for k in ("composition", "iou_initial", "iou", "epe_frame")})), end="")
    print(f"score: the report is {REPORTS.resolve() / 'index.html'}", flush=True)


if __name__ == "__main__":
    run(main)
