"""A figure of the confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np

from pipeline.report.figures import svg


def confusion_figure(rows: Sequence[str], columns: Sequence[str], counts: np.ndarray) -> str:
    """The confusion matrix as SVG: truth in rows, answers in columns, shaded by the share of the row."""
    figure, axes = plt.subplots(figsize=(2.6 + 0.27 * len(columns), 1.8 + 0.24 * len(rows)))
    shares = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        colour = "white" if shares[i, j] > 0.5 else "black"
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=6, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set_xlabel("answer (the true name where it is in an equivalence set of at most 3)")
    axes.set_ylabel("hidden")
    return svg(figure)
