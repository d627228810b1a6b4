"""Scores of clips summed up by suite and method, and what more samples or more simulations gain."""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.clips.intervals import NO_CLIPS, MeanInterval, bootstrap_mean, bootstrap_ratio

COSTS = ("simulations", "seconds")
COUNTS = ("matched", "found", "true")  # behind an F1, in this order: 2 matched / (found + true)
History = tuple[Sequence[int] | np.ndarray, Sequence[float] | np.ndarray]


@dataclass(frozen=True)
class Summary:
    """Means with intervals by suite and method.

    Attributes:
        intervals: [suite, method][metric].
        simulations: [suite, method], the mean a clip.
        seconds: [suite, method], the mean a clip; NaN where it is not known.
        counts: [suite, method][metric], the sums over clips of `COUNTS` behind each F1.
    """

    intervals: dict[tuple[str, str], dict[str, MeanInterval]]
    simulations: dict[tuple[str, str], float]
    seconds: dict[tuple[str, str], float]
    counts: dict[tuple[str, str], dict[str, tuple[int, ...]]] = field(default_factory=dict)


def summarise(
    rows: Iterable[Mapping[str, Any]],
    metrics: Sequence[str],
    resamples: int,
    seed: int = 0,
    f1_metrics: Sequence[str] = (),
) -> Summary:
    """Sum up the scores of clips. Rows are taken one after the other, and of each only 8 bytes a number are held.

    Args:
        rows: A row for each clip and method, with suite, method, simulations, seconds and some of the metrics. A metric
            that a row lacks is left out of that metric's mean.
        metrics: The metrics of which means are taken.
        resamples: Bootstrap resamples behind each interval.
        seed: Of the resamples.
        f1_metrics: F1 scores. Of each, rows have the columns `<metric>.<count>` for each of `COUNTS`; the F1 is that of
            the sums of these over the clips.
    """
    columns = [*metrics, *(f"{metric}.{count}" for metric in f1_metrics for count in COUNTS)]
    groups: dict[tuple[str, str], dict[str, array[float]]] = {}
    for row in rows:
        key = row["suite"], row["method"]
        if key not in groups:
            groups[key] = {name: array("d") for name in (*columns, *COSTS)}
        for name, numbers in groups[key].items():
            numbers.append(row[name] if name in COSTS else row.get(name, np.nan))
    intervals = {
        key: {m: bootstrap_mean(np.array(group[m]), resamples, seed) for m in metrics} for key, group in groups.items()
    }
    counts: dict[tuple[str, str], dict[str, tuple[int, ...]]] = {key: {} for key in groups}
    for key, group in groups.items():
        for metric in f1_metrics:
            matched, found, true = (np.array(group[f"{metric}.{count}"]) for count in COUNTS)
            intervals[key][metric] = bootstrap_ratio(2 * matched, found + true, resamples, seed)
            counts[key][metric] = tuple(int(np.nansum(of_clips)) for of_clips in (matched, found, true))
    simulations, seconds = ({key: float(np.mean(group[name])) for key, group in groups.items()} for name in COSTS)
    return Summary(intervals, simulations, seconds, counts)


def with_metrics(summary: Summary, metrics: Sequence[str]) -> Summary:
    """The summary of these metrics alone."""
    intervals = {key: {m: found[m] for m in metrics} for key, found in summary.intervals.items()}
    counts = {key: {m: found[m] for m in metrics if m in found} for key, found in summary.counts.items()}
    return Summary(intervals, summary.simulations, summary.seconds, counts)


def as_json(summary: Summary) -> dict[str, Any]:
    """suite -> method -> metric -> mean, without metrics that no clip has: what `dvc metrics` shows."""
    out: dict[str, Any] = {}
    for (suite, method), metrics in summary.intervals.items():
        means = {m: round(e.mean, 4) for m, e in metrics.items() if e.n}
        out.setdefault(suite, {})[method] = {**means, "clips": metrics["iou"].n}
    return out


def as_csv(summary: Summary) -> str:
    """One row per suite, method and metric with mean, interval and number of clips."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["suite", "method", "simulations", "metric", "mean", "low", "high", "clips"])
    for (suite, method), metrics in summary.intervals.items():
        for name, e in metrics.items():
            if e.n:
                numbers = [f"{v:.5g}" for v in (e.mean, e.low, e.high)]
                writer.writerow([suite, method, f"{summary.simulations[suite, method]:g}", name, *numbers, e.n])
    return text.getvalue()


def from_csv(rows: Sequence[Mapping[str, str]]) -> Summary:
    """The summary whose rows `as_csv` wrote; seconds are not in the file, and NaN here."""
    simulations = {(r["suite"], r["method"]): float(r["simulations"]) for r in rows}
    metrics = dict.fromkeys(r["metric"] for r in rows)
    intervals = {key: dict.fromkeys(metrics, NO_CLIPS) for key in simulations}
    for r in rows:
        intervals[r["suite"], r["method"]][r["metric"]] = MeanInterval.of_row(r)
    return Summary(intervals, simulations, dict.fromkeys(simulations, np.nan))


def best_of_k_curve(reward: np.ndarray, score: np.ndarray) -> np.ndarray:
    """(K,) expected `score` of the sample with the best `reward` among k drawn without replacement, k = 1 … K.

    The r-th best of K is the best of k with probability C(K - r - 1, k - 1) / C(K, k), r from 0.
    """
    count = len(reward)
    ordered = score[np.argsort(-reward, kind="stable")]
    out = np.empty(count)
    for k in range(1, count + 1):
        weight = np.zeros(count)
        weight[0] = k / count
        for r in range(1, count - k + 1):
            weight[r] = weight[r - 1] * (count - r - k + 1) / (count - r)
        out[k - 1] = weight @ ordered
    return out


def mean_best_so_far(histories: Callable[[], Iterable[History]], points: int = 24) -> list[tuple[int, float]]:
    """The mean over clips of the best reward so far, as (simulations, reward).

    The budgets run from the first at which every clip has a reward to the largest that any clip spent.

    Args:
        histories: Gives for each clip the rising numbers of simulations at which its best reward was recorded, and
            that reward. It is called twice, so that no clip's history need be held. Clips without any are left out.
        points: How many budgets.
    """
    first, last, clips = 0, 0, 0
    for spent, _ in histories():
        if len(spent):
            first, last, clips = max(first, int(spent[0])), max(last, int(spent[-1])), clips + 1
    if not clips:
        return []
    budgets = np.unique(np.linspace(first, last, points).astype(int))
    total = np.zeros(len(budgets))
    for spent, best in histories():
        if len(spent):
            total += np.asarray(best)[np.searchsorted(spent, budgets, "right") - 1]
    return [(int(b), float(v)) for b, v in zip(budgets, total / clips, strict=True)]
