"""The report's figures, as SVG text or JPEG bytes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import cv2
import matplotlib
import numpy as np

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from pipeline.evaluation.tables import Summary

COLOURS = ("#4c78a8", "#f58518", "#54a24b", "#b279a2", "#e45756", "#72b7b2")
#: Object colours in pictures, RGB.
PALETTE = np.array(
    [[230, 76, 60], [52, 152, 219], [46, 204, 113], [241, 196, 15], [155, 89, 182], [26, 188, 156], [230, 126, 34]],
    float,
)
plt.rcParams.update({"svg.hashsalt": "dynamics", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False})


def svg(figure: Figure) -> str:
    """The figure as an SVG element, the same text for the same figure."""
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    return text.getvalue()[text.getvalue().index("<svg") :]


def bars(summary: Summary, metric: str, label: str) -> str:
    """One group of bars per suite, one bar per method, with intervals."""
    suites = list(dict.fromkeys(s for s, _ in summary.estimates))
    methods = list(dict.fromkeys(m for _, m in summary.estimates))
    figure, axes = plt.subplots(figsize=(6.4, 2.8))
    width = 0.8 / len(methods)
    for k, method in enumerate(methods):
        places = [
            (i, summary.estimates[s, method][metric]) for i, s in enumerate(suites) if (s, method) in summary.estimates
        ]
        x = np.array([i for i, e in places if e.n]) + (k - (len(methods) - 1) / 2) * width
        kept = [e for _, e in places if e.n]
        mean = np.array([e.mean for e in kept])
        error = np.array([[e.mean - e.low for e in kept], [e.high - e.mean for e in kept]])
        axes.bar(
            x, mean, width * 0.92, yerr=error if kept else None, color=COLOURS[k], label=method, error_kw={"lw": 0.8}
        )
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
    axes.legend(frameon=False)
    return svg(figure)


def painted(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A frame (H, W, 3) uint8 with each object of a mask (h, w) tinted and outlined in its colour."""
    height, width = frame.shape[:2]
    mask = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST)
    out = frame.astype(float)
    for i in range(1, int(mask.max(initial=0)) + 1):
        inside = (mask == i).astype(np.uint8)
        colour = PALETTE[(i - 1) % len(PALETTE)]
        out[inside > 0] = 0.55 * out[inside > 0] + 0.45 * colour
        contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        canvas = np.ascontiguousarray(out.astype(np.uint8))
        cv2.drawContours(canvas, contours, -1, colour.tolist(), 2)
        out = canvas.astype(float)
    return out.astype(np.uint8)


def tiled(rows: Sequence[tuple[str, Sequence[np.ndarray]]], width: int = 240) -> np.ndarray:
    """Pictures (H, W, 3) uint8 in rows, each with its title above."""
    strips = []
    for title, pictures in rows:
        scaled = [
            cv2.resize(p, (width, round(width * p.shape[0] / p.shape[1])), interpolation=cv2.INTER_AREA)
            for p in pictures
        ]
        strip = np.concatenate([np.pad(p, ((0, 0), (0, 4), (0, 0)), constant_values=255) for p in scaled], 1)
        head = np.full((18, strip.shape[1], 3), 255, np.uint8)
        cv2.putText(head, title, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
        strips += [head, strip]
    longest = max(s.shape[1] for s in strips)
    return np.concatenate([np.pad(s, ((0, 0), (0, longest - s.shape[1]), (0, 0)), constant_values=255) for s in strips])


def jpeg(picture: np.ndarray) -> bytes:
    """An RGB picture (H, W, 3) uint8 as JPEG."""
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert done
    return data.tobytes()
