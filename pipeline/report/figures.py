"""The report's plots, as SVG text."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from pipeline.report.summary import Summary

COLOURS = ("#4c78a8", "#f58518", "#54a24b", "#b279a2", "#e45756", "#72b7b2", "#9d755d", "#bab0ac")
plt.rcParams.update({"svg.hashsalt": "dynamics", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def svg(figure: Figure) -> str:
    """The figure as an SVG element, the same text for the same figure."""
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    return text.getvalue()[text.getvalue().index("<svg") :]


def bars(summary: Summary, metric: str, label: str) -> str:
    """One group of bars per suite, one bar per method, with intervals."""
    suites = list(dict.fromkeys(s for s, _ in summary.intervals))
    methods = list(dict.fromkeys(m for _, m in summary.intervals))
    figure, axes = plt.subplots(figsize=(6.4, 2.8))
    width = 0.8 / len(methods)
    for k, method in enumerate(methods):
        found = [
            (i, summary.intervals[s, method][metric]) for i, s in enumerate(suites) if (s, method) in summary.intervals
        ]
        found = [(i, e) for i, e in found if e.n]
        x = np.array([i for i, _ in found]) + (k - (len(methods) - 1) / 2) * width
        error = np.array([[e.mean - e.low for _, e in found], [e.high - e.mean for _, e in found]])
        style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "label": method, "error_kw": {"lw": 0.8}}
        axes.bar(x, [e.mean for _, e in found], width * 0.92, yerr=error if found else None, **style)
    axes.set_xticks(range(len(suites)), suites)
    axes.set_ylabel(label)
    axes.legend(frameon=False, ncols=len(methods), loc="upper center", bbox_to_anchor=(0.5, 1.2))
    return svg(figure)


def curves(lines: Mapping[str, tuple[Sequence[float], Sequence[float]]], x_label: str, y_label: str) -> str:
    """Lines by name, each (x, y)."""
    figure, axes = plt.subplots(figsize=(4.2, 2.6))
    for k, (name, (x, y)) in enumerate(lines.items()):
        axes.plot(x, y, color=COLOURS[k % len(COLOURS)], label=name, marker="o" if len(x) < 12 else None, ms=3)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    return svg(figure)
