"""Score every answer of every suite, and write the report.

Reads data/{sample,events,render,flow,infer,best_of_k,cmaes,fit,predict}/<suite>, data/finetune, data/prefer, with
regress.enabled data/regress, reports/README.md, and the tables and texts of benchmarks/results/{learned,starts}.
Writes reports/: scores.json (metrics), scores.csv, scores.md, events.md, parameters.md, prediction.md, determined.md,
times.md, clips.csv (a row per clip and method), plots/*.csv (plots), index.html.
Clips that preference optimisation has used are summed up apart, as the suite "<suite>, used by prefer".
Parameters: seed, clip, events, sample.filters.visible_px, score, regress.enabled, and for the page's head model,
flow.source, infer.shots.
Run: python -m stages.score
"""

import csv
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.clips.events import Thresholds
from pipeline.csv_rows import read_rows, write_rows
from pipeline.report.determined import determined_table, spreads_by_kind
from pipeline.report.event_scores import EVENT_METRICS, KIND_METRICS
from pipeline.report.event_table import EVENTS, events_table
from pipeline.report.markdown import markdown
from pipeline.report.scene_scores import METRICS
from pipeline.report.scores_page import RunScores, scores_page, shown_clips
from pipeline.report.suite import AnsweredSuite, forecast_rows
from pipeline.report.summary import COUNTS, as_csv, as_json, summarise, with_metrics
from pipeline.report.tables import ERRORS, FORECAST, SCORES, metrics_table, times_table
from pipeline.shards.contents import check_contents
from pipeline.shards.dataset import open_shards
from pipeline.shards.output_errors import writing_to
from stages.graph.answering_model import CURVE, FOLDER, AnsweringModel, answering_model
from stages.graph.machine import machine_kind
from stages.graph.params import Params
from stages.graph.run import DATA, folder, run
from stages.graph.stage_params import load
from stages.graph.suite import open_suite

REPORTS = Path("reports")
BENCHMARKS = Path("benchmarks/results")
UNFINISHED = REPORTS / ".clips.csv.partial"
STAGES = ("render", "flow", "infer", "best_of_k", "cmaes", "fit")
SUITES = ("id", "held_out", "more", "real")
WITH_EVENTS = ("id", "held_out", "more")  # suites whose clips have known events
PREDICTED_SUITES = ("id", "real")
CLIP_COLUMNS = (
    *("suite", "clip", "method", "simulations", "iou_initial", "iou", "foreground_iou", "epe_first", "epe"),
    *("epe_frame", "penetration", "valid", "composition", "error.camera_height", "error.camera_pitch", "error.fov"),
    *("error.gravity", "error.mass", "error.sliding_friction", "error.rolling_friction", "error.damping"),
    *("error.position", "error.velocity", "error.angular_velocity", "error.size", "error.orientation"),
    *(f"{metric}.{count}" for metric in EVENT_METRICS for count in COUNTS),
)
PRINTED = ("composition", "iou_initial", "iou", "epe_frame")


def read_losses() -> dict[str, tuple[list[float], list[float]]]:
    """Steps and losses of the fine-tuning, by name."""
    out = {}
    check_contents(DATA / "finetune")
    for name, column in (("train", "loss"), ("validation", "eval_loss")):
        rows = read_rows(DATA / "finetune" / f"{column}.csv")
        out[name] = ([float(r["step"]) for r in rows], [float(r[column]) for r in rows])
    return out


def facts(params: Params, model: AnsweringModel, suites: Sequence[AnsweredSuite]) -> dict[str, str]:
    """The settings that the page names."""
    return {
        "machine": machine_kind(),
        "model": params.model.base,
        "prompt": f"{params.infer.shots}-shot" if params.infer.shots else "the clip alone, to a fine-tuned model",
        "input": params.model.input,
        "sees": params.model.sees,
        "reasoning": str(params.model.reasoning),
        "flow": params.flow.source,
        "preference optimisation": f"on {len(model.used)} clips of {model.suite}" if model.preferred else "none",
        "clips": ", ".join(f"{suite.name} {len(suite)}" for suite in suites),
        "answers, which all parse": str(sum(s.stages["infer"].manifest.notes.get("parsed", 0) for s in suites)),
    }


def written(rows: Iterable[Mapping[str, Any]], path: Path) -> Iterator[Mapping[str, Any]]:
    """The same rows, each of which is also written to a CSV file, so that they need not be held."""
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, CLIP_COLUMNS, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
            yield row


def write_tables(found: RunScores) -> None:
    """Every file of the report but the page and clips.csv."""
    write_rows(REPORTS / "plots" / "best_of_k.csv", found.best_of_k)
    write_rows(REPORTS / "plots" / "search.csv", found.searches)
    shutil.copyfile(FOLDER / CURVE, REPORTS / "plots" / "prefer.csv")
    (REPORTS / "scores.json").write_text(json.dumps(as_json(found.summary), indent=1) + "\n")
    (REPORTS / "scores.csv").write_text(as_csv(found.summary))
    made_on = f"\nMade on: {machine_kind()}. Results of the searches differ in the third digit between processors.\n"
    (REPORTS / "scores.md").write_text(markdown(*metrics_table(found.summary, {**SCORES, **EVENTS})) + made_on)
    (REPORTS / "events.md").write_text(markdown(*events_table(found.events)))
    (REPORTS / "parameters.md").write_text(markdown(*metrics_table(found.summary, ERRORS)))
    (REPORTS / "prediction.md").write_text(markdown(*metrics_table(found.forecast, FORECAST)))
    (REPORTS / "times.md").write_text(markdown(*times_table(found.summary)))
    (REPORTS / "determined.md").write_text(markdown(*determined_table(found.determined)))


def main() -> None:
    params = load("score")
    schedule = params.clip.schedule
    thresholds = Thresholds(**params.events.model_dump(), visible_px=params.sample.filters.visible_px)
    model = answering_model()
    stages = [*STAGES, *["regress"] * params.regress.enabled]
    of_suite = {name: [*stages, *["events"] * (name in WITH_EVENTS)] for name in SUITES}
    used = {name: frozenset(clip for clip in model.used if model.has_used(name, clip)) for name in SUITES}
    suites = [AnsweredSuite(name, open_suite(name, of_suite[name]), used[name]) for name in SUITES]
    event_metrics = [*EVENT_METRICS, *KIND_METRICS]
    with writing_to(REPORTS):
        rows = written((row for suite in suites for row in suite.score_rows(schedule, thresholds)), UNFINISHED)
        scores = summarise(rows, [*METRICS, *ERRORS], params.score.bootstrap, params.seed, event_metrics)
    summary = with_metrics(scores, [*METRICS, *EVENT_METRICS, *ERRORS])
    forecasts = (row for name in PREDICTED_SUITES for row in forecast_rows(name, open_shards(folder("predict", name))))
    found = RunScores(
        summary=summary,
        best_of_k=[row for suite in suites for row in suite.best_of_k_rows()],
        searches=[row for suite in suites for row in suite.search_rows()],
        training=read_losses(),
        determined=spreads_by_kind(clip for suite in suites for clip in suite.certainties()),
        forecast=summarise(forecasts, list(FORECAST), params.score.bootstrap, params.seed),
        events=with_metrics(scores, event_metrics),
    )
    gallery = {suite.name: shown_clips(suite, params.score.gallery, schedule) for suite in suites if len(suite)}
    text = scores_page(found, gallery, facts(params, model, suites), REPORTS, BENCHMARKS)
    with writing_to(REPORTS):
        UNFINISHED.replace(REPORTS / "clips.csv")
        write_tables(found)
        (REPORTS / "index.html").write_text(text, encoding="utf-8")
    print(markdown(*metrics_table(summary, {m: SCORES[m] for m in PRINTED})), end="")
    print(f"score: the report is {REPORTS.resolve() / 'index.html'}", flush=True)


if __name__ == "__main__":
    run(main)
