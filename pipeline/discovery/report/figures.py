"""The plots of report.html, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa

from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.selection.comparison import Compared
from pipeline.discovery.where.path_evidence import smooth_velocity
from pipeline.report.figures import COLOURS, svg

REGIME_COLOURS = {
    "flight": COLOURS[0],
    "sliding": COLOURS[1],
    "rolling": COLOURS[2],
    "spinning": COLOURS[3],
    "resting": "#999999",
}
MOST_SHOWN = 4  # clips


def residual_figure(table: pa.Table) -> str:
    """Residuals of all clips over time, before and after, by regime."""
    figure, rows = plt.subplots(2, 1, figsize=(8.4, 4.6), sharex=True)
    regime, used = np.array(table["regime"].to_pylist()), np.array(table["used"].to_pylist())
    time = table["time"].to_numpy() - _clip_starts(table)
    for axes, kind, title in zip(
        rows, ("before", "after"), ("calibrated model", "with the verdict's effects"), strict=True
    ):
        values = np.stack([table[f"{kind}_{a}"].to_numpy() for a in "xyz"], 1) * 1e3
        for name, colour in REGIME_COLOURS.items():
            chosen = (regime == name) & used
            if chosen.any():
                for a in range(3):
                    axes.plot(
                        time[chosen],
                        values[chosen, a],
                        ".",
                        ms=2,
                        color=colour,
                        alpha=0.5,
                        label=name if a == 0 else None,
                    )
        axes.axhline(0, color="#444", lw=0.6)
        axes.set_ylabel("residual, mm")
        axes.set_title(title, loc="left", fontsize=9)
    rows[0].legend(frameon=False, ncols=5, markerscale=4)
    rows[1].set_xlabel("time since the clip's start, s")
    return svg(figure)


def where_figure(found: Discovery, table: pa.Table) -> str:
    """Where the known scene fails: the paths in the place, and the speed over time, with what disagrees marked."""
    names = [o.name for o in found.problem.known.scene.objects]
    figure, (place, course) = plt.subplots(1, 2, figsize=(8.4, 3.6))
    clip, body = np.array(table["clip"].to_pylist()), np.array(table["object"].to_pylist())
    x, time = np.stack([table[f"measured_{a}"].to_numpy() for a in "xyz"], 1), table["time"].to_numpy()
    upright = np.ptp(x[:, 2]) > 0.3 * max(np.ptp(x[:, 0]), np.ptp(x[:, 1]), 1e-9)
    across, up = (0, 2) if upright else (0, 1)
    for name in np.unique(clip):
        for who in np.unique(body[clip == name]):
            rows = (clip == name) & (body == who)
            t, path = time[rows], x[rows]
            if len(t) < 3:
                continue
            speed = np.linalg.norm(smooth_velocity(t, path), axis=1)
            place.plot(path[:, across], path[:, up], color="#bbbbbb", lw=0.8)
            course.plot(t - t[0], speed, color="#bbbbbb", lw=0.8)
            for s in found.disagreement:
                if (s.clip, names[s.object]) == (name, who):
                    inside = (t >= s.start) & (t <= s.end)
                    place.plot(path[inside, across], path[inside, up], ".", ms=3, color=COLOURS[1])
                    course.plot(t[inside] - t[0], speed[inside], ".", ms=3, color=COLOURS[1])
    place.set_xlabel("x, m")
    place.set_ylabel("z, m" if upright else "y, m")
    place.set_aspect("equal", "datalim")
    course.set_xlabel("time since the clip's start, s")
    course.set_ylabel("speed, m/s")
    figure.tight_layout()
    return svg(figure)


def _clip_starts(table: pa.Table) -> np.ndarray:
    clip, time = np.array(table["clip"].to_pylist()), table["time"].to_numpy()
    starts = {c: time[clip == c].min() for c in np.unique(clip)}
    return np.array([starts[c] for c in clip])


def trajectory_figure(found: Discovery, table: pa.Table) -> str:
    """Measured and predicted paths of some clips: height over time, and from above."""
    clips = [*found.problem.held_out, *found.problem.fitted][:MOST_SHOWN]
    figure, places = plt.subplots(2, len(clips), figsize=(2.6 * len(clips) + 0.6, 4.6), squeeze=False)
    clip, arc = np.array(table["clip"].to_pylist()), table["arc"].to_numpy()
    measured, before, after = (
        np.stack([table[f"{kind}_{a}"].to_numpy() for a in "xyz"], 1) for kind in ("measured", "before", "after")
    )
    time = table["time"].to_numpy()
    for column, name in enumerate(clips):
        rows = clip == name
        x = measured[rows]
        top, bottom = places[:, column]
        for k in np.unique(arc[rows]):
            mine = rows & (arc == k)
            for residual, colour, label in (
                (before, COLOURS[1], "calibrated"),
                (after, COLOURS[2], "with the effects"),
            ):
                path = measured[mine] - residual[mine]
                top.plot(time[mine], path[:, 2], color=colour, lw=1.2, label=label if k == arc[rows].min() else None)
                bottom.plot(path[:, 0], path[:, 1], color=colour, lw=1.2)
        top.plot(time[rows], x[:, 2], ".", ms=2.5, color="#222", label="measured")
        bottom.plot(x[:, 0], x[:, 1], ".", ms=2.5, color="#222")
        top.set_title(f"{name}{' (held out)' if name in found.problem.held_out else ''}", fontsize=9)
        top.set_xlabel("time, s")
        bottom.set_xlabel("x, m")
        bottom.set_aspect("equal", "datalim")
    places[0, 0].set_ylabel("z, m")
    places[1, 0].set_ylabel("y, m")
    places[0, 0].legend(frameon=False, fontsize=7)
    figure.tight_layout()
    return svg(figure)


def ranking_figure(selection: Compared, named: Sequence[str]) -> str:
    """How much better than the calibrated model each candidate is. named: effects of the verdict."""
    shown = sorted(selection.singles, key=lambda c: c.score)[:12]
    figure, axes = plt.subplots(figsize=(6.4, 0.4 + 0.27 * max(len(shown), 1)))
    gains = [max(selection.none.score - c.score, 0.1) for c in shown]
    colours = [COLOURS[2] if set(c.effects) <= set(named) else COLOURS[0] for c in shown]
    axes.barh(range(len(shown)), gains, color=colours)
    axes.set_yticks(range(len(shown)), [" + ".join(c.effects) for c in shown])
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("better than the calibrated model by (score: chi squared and the price of parameters)")
    return svg(figure)
