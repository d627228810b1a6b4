"""The sections of the report, from summed-up scores, curves and pictures of clips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.evaluation.determined import Kind
from pipeline.evaluation.determined import table as determined_table
from pipeline.evaluation.figures import bars, curves
from pipeline.evaluation.learned_tables import Rows, differences_table, samples_table, scaling_table
from pipeline.evaluation.report import Section, drawing, folded, html_table
from pipeline.evaluation.starts_table import starts_table
from pipeline.evaluation.tables import Summary, table

#: Metric -> heading of the table of scores.
COLUMNS = {
    "composition": "composition",
    "iou_initial": "IoU, first frame",
    "iou": "IoU, sequence",
    "foreground_iou": "IoU, foreground",
    "epe_first": "EPE, first pair",
    "epe": "EPE, foreground",
    "epe_frame": "EPE, whole frame",
    "penetration": "penetration, m",
    "valid": "valid",
}
#: The same for the errors of parameters, with their units.
ERRORS = {
    "error.camera_height": "camera height, m",
    "error.camera_pitch": "camera pitch, deg",
    "error.fov": "field of view, deg",
    "error.gravity": "gravity, m/s²",
    "error.size": "size, m",
    "error.position": "position, m",
    "error.velocity": "velocity, m/s",
    "error.angular_velocity": "angular velocity, rad/s",
    "error.orientation": "orientation, deg",
    "error.mass": "mass, kg",
    "error.sliding_friction": "sliding friction",
    "error.rolling_friction": "rolling friction, m",
    "error.damping": "damping",
}
#: The same for predictions.
PREDICTED = {"iou": "IoU, unseen half", "seen": "IoU, seen half"}
_SCORES = (
    "Means with 95 % bootstrap intervals over clips, at 480×320. Sampled suites are compared with their exact masks "
    "and flow in all frames; the suite real with its given masks, and with estimated flow in the model's ten pairs. "
    "Simulations and seconds (of one worker): what the answer cost a clip, without the model's own time."
)
_ERRORS = (
    "Mean absolute errors over clips whose composition is right. The mass of a body that touches nothing movable, and "
    "the absolute scale, are not determined by a clip."
)
_LEARNED = (
    "From a run of its own on more clips (python -m benchmarks.learned; its answers are in "
    "benchmarks/results/learned): greedy answers, and the best of K samples by replay, with 95 % bootstrap intervals. "
    "real: another engine's clips."
)
_SAMPLES = "Of the same run: sequence IoU of the best of K samples by replay, at the search's size."
_DIFFERENCES = (
    "Of the same run: greedy sequence IoU, clip by clip. tiny, the shipped model, is shown RAFT's flow and answers "
    "with reasoning; silent: the same weights asked for the scene at once; tokens: their numbers chosen token by "
    "token, as words, not by medians; noisy: they are shown exact flow with the noise of training. flow, rgb, none: "
    "models that were trained alike for 56 minutes of one core, on clips of one object, and are asked about such, "
    "numbers token by token: shown flow, frames, and flow with answers without reasoning. Frames tell the camera's "
    "pitch better and motion no worse; without words all of a short training goes into the scene."
)
_SCALING = (
    "Of a run of its own (python -m benchmarks.scaling): the shipped model in its first training, before the learning "
    "rate fell; greedy, numbers token by token, on fresh clips of 1 to 3 objects with exact flow and the noise of "
    "training. The last lines go on a straight line in the scores' logit against the logarithm of the clips, with the "
    "range when any one checkpoint is left out; nothing says that scores follow it so far."
)
_STARTS = (
    "From a run of its own on more clips (python -m benchmarks.starts; its answers are in benchmarks/results/starts): "
    "sequence IoU after so many simulations, with 95 % bootstrap intervals, by where the search starts. given: the "
    "classical guess with the true shapes; guess: nothing given; motion: nothing given, not even masks. id: sampled "
    "clips; real: another engine's. The last columns are for the largest budget; penetration is the largest of all "
    "answers. greedy, best1, bestK: what the shipped model answers after the graph's fine-tuning, its first sample, "
    "and the best of 32 by replay; some of these were searched with 3,200 simulations only."
)
_DETERMINED = (
    "Of the scenes that the search found: the spread (standard deviation) of each number by the curvature of the cost "
    "there, inflated by what was measured on other clips; determined: less than half of the spread of its bounds. The "
    "absolute scale is not seen by one camera: lengths, velocities and gravity carry a common factor of e^±0.5, the "
    "camera's height and the sizes among them. A mass has the factor by which it may be off."
)
_PREDICTION = (
    "The search saw the first half second alone and started from the classical guess. Sequence IoU over the second "
    "half, with 95 % bootstrap intervals: of the scene's replay, of the last masks seen moved as that replay moves, "
    "and without physics of masks that move on at their last velocity and of masks that stay."
)
Curve = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class Benchmarks:
    """What runs of their own found, kept in benchmarks/results: answers of models, pairs of them, a training's
    checkpoints, and starts of the search."""

    learned: Summary
    differences: Rows
    scaling: Rows
    starts: Rows


@dataclass(frozen=True)
class ShownClip:
    """A clip in the gallery: its picture as HTML, what the model wrote, and the scene after the search."""

    picture: str
    written: str
    scene: str


def lines(rows: Sequence[Mapping[str, Any]], x: str, y: str) -> dict[str, Curve]:
    """Rows with x and y, as one curve a series."""
    names = list(dict.fromkeys(r["series"] for r in rows))
    return {s: ([r[x] for r in rows if r["series"] == s], [r[y] for r in rows if r["series"] == s]) for s in names}


def sections(
    summary: Summary,
    best_of_k: Sequence[Mapping[str, Any]],
    searches: Sequence[Mapping[str, Any]],
    training: Mapping[str, Curve],
    benchmarks: Benchmarks,
    determined: Mapping[str, Kind],
    prediction: Summary,
    gallery: Mapping[str, Sequence[ShownClip]],
) -> list[Section]:
    """best_of_k: rows of series, k, iou; searches: rows of series, simulations, reward; training: losses by name;
    determined: kinds of parameters; prediction: of the unseen half; gallery: the clips shown of each suite."""
    best, reward = lines(best_of_k, "k", "iou"), lines(searches, "simulations", "reward")
    figures = [
        drawing(bars(summary, "iou", "sequence IoU"), "Sequence IoU by suite and method, with 95 % intervals."),
        drawing(curves(best, "k", "IoU"), "Expected IoU of the best of k samples, at the search's size."),
        drawing(curves(reward, "simulations", "reward"), "Best reward (IoU − EPE) after so many simulations."),
        drawing(curves(training, "step", "loss, nats a token"), "Fine-tuning."),
    ]
    out = [
        Section("Scores", _SCORES, html_table(*table(summary, COLUMNS))),
        Section("Curves", "", f'<div class="row">{"".join(figures)}</div>'),
        Section("Parameter errors", _ERRORS, html_table(*table(summary, ERRORS))),
        Section("The model before any search", _LEARNED, html_table(*table(benchmarks.learned, COLUMNS))),
        Section("More samples", _SAMPLES, html_table(*samples_table(benchmarks.learned))),
        Section("Parameter errors of the model", _ERRORS, html_table(*table(benchmarks.learned, ERRORS))),
        Section(
            "Reasoning, frames, and RAFT's flow", _DIFFERENCES, html_table(*differences_table(benchmarks.differences))
        ),
        Section("More clips", _SCALING, html_table(*scaling_table(benchmarks.scaling))),
        Section("Starts and budgets", _STARTS, html_table(*starts_table(benchmarks.starts))),
        Section("What a clip determines", _DETERMINED, html_table(*determined_table(determined))),
        Section("Prediction", _PREDICTION, html_table(*table(prediction, PREDICTED))),
    ]
    for suite, clips in gallery.items():
        body = "".join(
            clip.picture
            + folded("what the model wrote (greedy)", clip.written)
            + folded("the scene after the search", clip.scene)
            for clip in clips
        )
        out.append(Section(f"Clips of {suite}", "The first clips of the suite, not chosen.", body))
    return out
