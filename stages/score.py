"""Score every answer of every suite, and write the report.

Reads data/{sample,render,flow,infer,best_of_k,cmaes,fit,predict}/<suite>, data/finetune, data/prefer, with
regress.enabled data/regress, and the tables of benchmarks/results that BENCHMARKS names. Writes reports/: scores.json
(metrics), scores.csv, scores.md, parameters.md, prediction.md, determined.md, clips.csv (a row per clip and method),
plots/*.csv (plots), index.html.
Clips that preference optimisation has used are summed up apart, as the suite "<suite>, used by prefer".
Parameters: seed, clip, score, regress.enabled, and for the page's head model, flow.source, infer.shots.
Run: python -m stages.score
"""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.evaluation.csv_rows import read_rows, write_rows
from pipeline.evaluation.determined import by_kind
from pipeline.evaluation.determined import table as determined_table
from pipeline.evaluation.figures import jpeg
from pipeline.evaluation.gallery import clip_picture
from pipeline.evaluation.mean_curves import best_of_curve, mean_curve
from pipeline.evaluation.report import page, picture
from pipeline.evaluation.scene_scores import METRICS, score
from pipeline.evaluation.sections import COLUMNS, ERRORS, PREDICTED, Benchmarks, ShownClip, sections
from pipeline.evaluation.tables import as_csv, as_json, from_csv, markdown, summarise, table
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.shards.dataset import open_shards
from pipeline.shards.output_errors import writing_to
from stages.graph.answering_model import CURVE, FOLDER, AnsweringModel, answering_model
from stages.graph.run import DATA, folder, run
from stages.graph.stage_params import load
from stages.graph.suite import Suite, greedy_row, open_suite, reference

REPORTS = Path("reports")
BENCHMARKS = ("learned/learned.csv", "learned/differences.csv", "learned/scaling.csv", "starts/starts.csv")
PREDICTED_SUITES = ("id", "real")
PREDICTIONS = {"last mask, moved by the search": "carried", "constant velocity": "velocity", "frozen": "frozen"}
SUITES = ("id", "held_out", "more", "real")
PRINTED = ("composition", "iou_initial", "iou", "epe_frame")
TITLE = "Video in, physics out: the scores"
LEAD = (
    "Every clip is answered by the model with a scene, MuJoCo replays it, and the replay is compared with the clip: "
    "greedy, the best of K samples by replay, after CMA-ES from the best samples, and after the search, which has a "
    "classical guess (blobs lifted to the ground, no learning) among its starts; that guess is scored too."
)
STAGES = ("render", "flow", "infer", "best_of_k", "cmaes", "fit")


def answers(suite: Suite, clip: int) -> dict[str, tuple[str, int]]:
    """By method: the answer's scene text and what it cost in simulations."""
    ranked = suite["best_of_k"][clip].rows()
    searched, fitted = suite["cmaes"][clip].row(), suite["fit"][clip].row()
    guess = {} if fitted["guess"] is None else {"guess": (fitted["guess"], fitted["guess_simulations"])}
    regressed = {"vivit": (suite["regress"][clip].row()["scene"], 0)} if "regress" in suite else {}
    return {
        **regressed,
        **guess,
        "greedy": (greedy_row(suite, clip)["scene"], 0),
        f"best@{len(ranked)}": (ranked[0]["scene"], len(ranked)),
        "cmaes": (searched["scene"], len(ranked) + searched["simulations"]),
        "search": (fitted["scene"], len(ranked) + fitted["simulations"]),
    }


def seconds_by_method(suite: Suite) -> dict[str, float]:
    """Seconds a clip of one worker behind best-of-K and the searches; NaN where the store has forgotten them."""
    spent = {stage: suite[stage].compute_seconds() for stage in ("best_of_k", "cmaes", "fit")}
    each = {stage: np.nan if s is None else s / max(len(suite["infer"]), 1) for stage, s in spent.items()}
    best = each["best_of_k"]
    return {
        "vivit": 0.0,
        "guess": np.nan,
        "greedy": 0.0,
        "best": best,
        "cmaes": best + each["cmaes"],
        "search": best + each["fit"],
    }


def told_apart(name: str, clip: int, model: AnsweringModel) -> str:
    """The suite under which a clip's scores are summed up: a clip that the model has seen says nothing about others."""
    return f"{name}, used by prefer" if model.has_used(name, clip) else name


def score_suite(name: str, suite: Suite, schedule: Schedule, model: AnsweringModel) -> list[dict[str, Any]]:
    rows, seconds = [], seconds_by_method(suite)
    for clip in tqdm(range(len(suite["infer"])), desc=f"score {name}", unit="clip", disable=None):
        truth = reference(suite, clip, schedule)
        group = told_apart(name, clip, model)
        for method, (scene, cost) in answers(suite, clip).items():
            spent = seconds[method.split("@")[0]]
            head = {"suite": group, "clip": clip, "method": method, "simulations": cost, "seconds": spent}
            rows.append({**head, **score(read_scene(scene), truth, schedule)})
    return rows


def curve_rows(name: str, suite: Suite, model: AnsweringModel) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """What more samples and more simulations buy, means over clips that the model has not seen: rows of best_of_k.csv
    and search.csv in plots/."""
    fresh = [clip for clip in range(len(suite["infer"])) if not model.has_used(name, clip)]
    if not fresh:
        return [], []
    ranked = [suite["best_of_k"][clip].rows() for clip in fresh]
    best = [best_of_curve(np.array([r["reward"] for r in rows]), np.array([r["iou"] for r in rows])) for rows in ranked]
    searched = []
    for method, stage in (("cmaes", "cmaes"), ("search", "fit")):
        curves = [(row["spent"], row["history"]) for row in (suite[stage][clip].row() for clip in fresh)]
        searched += [{"series": f"{name}: {method}", "simulations": s, "reward": r} for s, r in mean_curve(curves)]
    return (
        [{"series": name, "k": k + 1, "iou": float(v)} for k, v in enumerate(np.mean(best, 0))],
        searched,
    )


def shown_clips(name: str, suite: Suite, count: int, schedule: Schedule, model: AnsweringModel) -> list[ShownClip]:
    out = []
    for clip in range(min(count, len(suite["infer"]))):
        seen, found = suite["render"][clip], answers(suite, clip)
        scenes = {method: read_scene(text) for method, (text, _) in found.items()}
        flow = suite["flow"][clip].array("flow")
        image = clip_picture(seen.array("rgb"), seen.array("mask"), flow, scenes, schedule)
        label = seen.row()["name"] if name == "real" else clip
        written = greedy_row(suite, clip)["text"]
        out.append(
            ShownClip(picture(jpeg(image), f"{told_apart(name, clip, model)}/{label}"), written, found["search"][0])
        )
    return out


def prediction_rows(name: str) -> list[dict[str, Any]]:
    """Rows of suite, method, iou over the unseen part, and of the search over the seen one."""
    rows = []
    for clip in open_shards(folder("predict", name)):
        row = clip.row()
        head = {"suite": name, "clip": row["clip"], "simulations": 0, "seconds": np.nan}
        rows.append({**head, "method": "search", "iou": row["search"], "seen": row["seen"],
                     "simulations": row["simulations"]})  # fmt: skip
        rows += [{**head, "method": method, "iou": row[column]} for method, column in PREDICTIONS.items()]
    return rows


def determined_clips(suite: Suite) -> list[tuple[list[dict[str, Any]], Scene, list[int], Scene | None]]:
    """Of each clip what its search was sure of, its scene, the instances of the objects, and the truth."""
    out = []
    for clip, found in enumerate(suite["fit"]):
        row = found.row()
        truth = read_scene(suite["sample"][clip].row()["scene"]) if "sample" in suite else None
        out.append((row["certainty"], read_scene(row["scene"]), row["instance"], truth))
    return out


def read_curve(path: Path) -> tuple[list[float], list[float]]:
    rows = list(csv.reader(path.open()))[1:]
    return [float(r[0]) for r in rows], [float(r[1]) for r in rows]


def main() -> None:
    params = load("score")
    schedule = params.clip.schedule
    stages = [*STAGES, *["regress"] * params.regress.enabled]
    suites = {name: open_suite(name, stages) for name in SUITES}
    model = answering_model()
    rows = [row for name, suite in suites.items() for row in score_suite(name, suite, schedule, model)]
    rng = np.random.default_rng(params.seed)
    summary = summarise(rows, [*METRICS, *ERRORS], params.score.bootstrap, rng)
    both = [curve_rows(name, suite, model) for name, suite in suites.items()]
    best_of_k, searches = ([row for part in each for row in part] for each in zip(*both, strict=True))
    predicted = [row for name in PREDICTED_SUITES for row in prediction_rows(name)]
    prediction = summarise(predicted, list(PREDICTED), params.score.bootstrap, rng)
    determined = by_kind([clip for suite in suites.values() for clip in determined_clips(suite)])
    training = {
        "train": read_curve(DATA / "finetune/loss.csv"),
        "validation": read_curve(DATA / "finetune/eval_loss.csv"),
    }
    learned, *others = (read_rows(Path("benchmarks/results") / name) for name in BENCHMARKS)
    benchmarks = Benchmarks(from_csv(learned), *others)
    gallery = {
        n: shown_clips(n, s, params.score.gallery, schedule, model) for n, s in suites.items() if len(s["infer"])
    }
    facts = {
        "model": params.model.base,
        "prompt": f"{params.infer.shots}-shot" if params.infer.shots else "the clip alone, to a fine-tuned model",
        "input": params.model.input,
        "reasoning": str(params.model.reasoning),
        "flow": params.flow.source,
        "preference optimisation": f"on {len(model.used)} clips of {model.suite}" if model.preferred else "none",
        "clips": ", ".join(f"{name} {len(suite['infer'])}" for name, suite in suites.items()),
        "answers, which all parse": str(sum(s["infer"].manifest.notes.get("parsed", 0) for s in suites.values())),
    }
    with writing_to(REPORTS):
        write_rows(REPORTS / "clips.csv", [{k: v for k, v in row.items() if k != "seconds"} for row in rows])
        write_rows(REPORTS / "plots" / "best_of_k.csv", best_of_k)
        write_rows(REPORTS / "plots" / "search.csv", searches)
        shutil.copyfile(FOLDER / CURVE, REPORTS / "plots" / "prefer.csv")
        (REPORTS / "scores.json").write_text(json.dumps(as_json(summary), indent=1) + "\n")
        (REPORTS / "scores.csv").write_text(as_csv(summary))
        (REPORTS / "scores.md").write_text(markdown(*table(summary, COLUMNS)))
        (REPORTS / "parameters.md").write_text(markdown(*table(summary, ERRORS)))
        (REPORTS / "prediction.md").write_text(markdown(*table(prediction, PREDICTED)))
        (REPORTS / "determined.md").write_text(markdown(*determined_table(determined)))
        parts = sections(summary, best_of_k, searches, training, benchmarks, determined, prediction, gallery)
        text = page(TITLE, LEAD, facts, parts)
        (REPORTS / "index.html").write_text(text, encoding="utf-8")
    print(markdown(*table(summary, {m: COLUMNS[m] for m in PRINTED})), end="")
    print(f"score: the report is {REPORTS.resolve() / 'index.html'}", flush=True)


if __name__ == "__main__":
    run(main)
