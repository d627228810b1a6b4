"""The page of the scores, `reports/index.html`: pictures, one table of the sequence IoU, then everything else, folded.

Its texts stand beside the results that they explain, in the README.md of `reports` and of folders of
`benchmarks/results`: the text below a heading there goes under the same heading on the page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import read_rows
from pipeline.report.clip_pictures import PANELS, animation, as_jpeg, as_webp, stills
from pipeline.report.determined import KindSpreads, determined_table
from pipeline.report.event_table import EVENTS, events_table
from pipeline.report.figures import bars, curves
from pipeline.report.suite import AnsweredSuite, greedy_row
from pipeline.report.summary import Summary, from_csv
from pipeline.report.tables import (
    ERRORS,
    FORECAST,
    SCORES,
    Table,
    differences_table,
    headline_table,
    metrics_table,
    samples_table,
    starts_table,
)
from pipeline.report.written_report import Section, drawing, folded, html_table, page, picture, prose_by_heading
from pipeline.scene.text import read_scene

TITLE = "Video in, physics out: the scores"
LEAD = (
    "A model answers each clip with a scene, MuJoCo replays the scene, and the replay is compared with the clip. The "
    "methods: guess (classical, no learning), greedy (the model's single best answer), best@K (the best of K samples "
    "by replay), cmaes (CMA-ES from the best samples) and search (Gauss-Newton and jumps from the best samples and the "
    "guess)."
)
SLOWED = 2  # animations play at a half of the recorded speed
Curve = tuple[Sequence[float], Sequence[float]]
Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class RunScores:
    """What the run of the graph found.

    Attributes:
        summary: Scores by suite and method.
        best_of_k: Rows of series, k, iou.
        searches: Rows of series, simulations, reward.
        training: Losses of the fine-tuning by name, as (steps, losses).
        determined: Spreads by kind of parameter.
        forecast: Scores of forecasts by suite and method.
        events: F1 of events by suite and method, in all and by kind.
    """

    summary: Summary
    best_of_k: Rows
    searches: Rows
    training: Mapping[str, Curve]
    determined: Mapping[str, KindSpreads]
    forecast: Summary
    events: Summary


@dataclass(frozen=True)
class ShownClip:
    """A clip on the page.

    Attributes:
        animation: Input, replay of the search and its outlines, as HTML.
        stills: Masks, flow and all replays, as HTML.
        written: What the model wrote, greedy.
        scene: The scene after the search, as text.
    """

    animation: str
    stills: str
    written: str
    scene: str


def shown_clips(suite: AnsweredSuite, count: int, schedule: Schedule) -> list[ShownClip]:
    """The first `count` clips of a suite."""
    out = []
    for clip in range(min(count, len(suite))):
        rendered, answers = suite.stages["render"][clip], suite.answers(clip)
        frames, masks, flow = rendered.array("rgb"), rendered.array("mask"), suite.stages["flow"][clip].array("flow")
        scenes = {method: read_scene(text) for method, (text, _) in answers.items()}
        moving = as_webp(animation(frames, scenes["search"], schedule), schedule.fps / SLOWED)
        sheet = as_jpeg(stills(frames, masks, flow, scenes, schedule))
        label = suite.label(clip)
        out.append(
            ShownClip(
                animation=picture(moving, f"{label}, at half speed", PANELS),
                stills=picture(sheet, f"{label}: masks, flow and the replay of each method"),
                written=greedy_row(suite.stages, clip)["text"],
                scene=answers["search"][0],
            )
        )
    return out


def benchmark_tables(results: Path) -> dict[str, dict[str, Table]]:
    """The tables of the benchmarks whose results are kept, by folder of `results` and heading of its README.md."""
    learned = from_csv(read_rows(results / "learned" / "learned.csv"))
    return {
        "learned": {
            "The model before any search": metrics_table(learned, SCORES),
            "More samples": samples_table(learned),
            "Parameter errors of the model": metrics_table(learned, ERRORS, costs=False),
            "Reasoning, frames, and RAFT's flow": differences_table(
                read_rows(results / "learned" / "differences.csv"), {**SCORES, **EVENTS}
            ),
        },
        "starts": {"Starts and budgets": starts_table(read_rows(results / "starts" / "starts.csv"))},
    }


def scores_page(
    run: RunScores, gallery: Mapping[str, Sequence[ShownClip]], facts: Mapping[str, str], reports: Path, results: Path
) -> str:
    """The page as HTML.

    Args:
        run: What the run found.
        gallery: The clips shown, by suite.
        facts: Settings of the run, name to value, the machine among them.
        reports: Folder of the page, with README.md.
        results: Folder of the benchmarks' results.
    """
    text = prose_by_heading(reports / "README.md")
    tables = {
        "Scores": metrics_table(run.summary, {**SCORES, **EVENTS}),
        "Parameter errors": metrics_table(run.summary, ERRORS, costs=False),
        "Events": events_table(run.events),
        "What a clip determines": determined_table(run.determined),
        "Forecasts": metrics_table(run.forecast, FORECAST),
    }
    first = "".join(clips[0].animation for clips in gallery.values() if clips)
    out = [
        Section(
            "Clips and replays",
            "The first clip of each suite, not chosen; the replay is the search's.",
            f'<div class="pictures">{first}</div>',
        ),
        Section("Sequence IoU", "", text["Sequence IoU"] + html_table(*headline_table(run.summary))),
        Section("Curves", "", f'<div class="row">{"".join(_figures(run))}</div>', folded=True),
        *(Section(title, "", text[title] + html_table(*table), folded=True) for title, table in tables.items()),
        *(_clip_section(suite, clips) for suite, clips in gallery.items()),
    ]
    for folder, by_heading in benchmark_tables(results).items():
        text = prose_by_heading(results / folder / "README.md", f"../{results.as_posix()}/{folder}")
        out += [
            Section(title, "", text[title] + html_table(*table), folded=True) for title, table in by_heading.items()
        ]
    return page(TITLE, LEAD, facts, out)


def _figures(run: RunScores) -> list[str]:
    best, reward = _series(run.best_of_k, "k", "iou"), _series(run.searches, "simulations", "reward")
    return [
        drawing(bars(run.summary, "iou", "sequence IoU"), "Sequence IoU by suite and method, with 95 % intervals."),
        drawing(curves(best, "k", "IoU"), "Expected IoU of the best of k samples, at the search's size."),
        drawing(curves(reward, "simulations", "reward"), "Best reward (IoU − EPE) after so many simulations."),
        drawing(curves(run.training, "step", "loss, nats a token"), "Fine-tuning."),
    ]


def _series(rows: Rows, x: str, y: str) -> dict[str, Curve]:
    names = list(dict.fromkeys(r["series"] for r in rows))
    return {s: ([r[x] for r in rows if r["series"] == s], [r[y] for r in rows if r["series"] == s]) for s in names}


def _clip_section(suite: str, clips: Sequence[ShownClip]) -> Section:
    moving = "".join(clip.animation for clip in clips[1:])
    details = "".join(
        clip.stills
        + folded("what the model wrote (greedy)", clip.written)
        + folded("the scene after the search", clip.scene)
        for clip in clips
    )
    note = f"The first {len(clips)} clips of the suite, not chosen."
    return Section(f"Clips of {suite}", note, f'<div class="pictures">{moving}</div>{details}', folded=True)
