"""The plots of report.html for a mechanism, as SVG."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.report.figures import COLOURS, svg

MOST_SHOWN = 4  # columns, and clips of each


def _rows(table: pa.Table, clip: str, column: str) -> pa.Table:
    return table.filter(pc.and_(pc.equal(table["clip"], clip), pc.equal(table["object"], column)))


def motion_figure(table: pa.Table) -> str:
    """Measured and predicted columns over time: what was not fitted first."""
    held = table.filter(table["held_out"])
    clips = list(dict.fromkeys([*held["clip"].to_pylist(), *table["clip"].to_pylist()]))[:MOST_SHOWN]
    columns = list(dict.fromkeys(table["object"].to_pylist()))[:MOST_SHOWN]
    figure, places = plt.subplots(
        len(columns), len(clips), figsize=(max(2.6 * len(clips), 6.4), 2.2 * len(columns)), squeeze=False
    )
    for i, column in enumerate(columns):
        for k, clip in enumerate(clips):
            axes, rows = places[i, k], _rows(table, clip, column)
            t, y = rows["time"].to_numpy(), rows["measured"].to_numpy()
            axes.plot(t, y, ".", ms=2, color="#222", label="measured")
            for kind, colour, label in (
                ("before", COLOURS[1], "calibrated"),
                ("after", COLOURS[2], "with the effects"),
            ):
                axes.plot(t, y - rows[kind].to_numpy(), color=colour, lw=1, label=label)
            ahead = rows["held_out"].to_numpy(zero_copy_only=False)
            if ahead.any():
                axes.axvspan(t[ahead][0], t[ahead][-1], color="#eee", zorder=-1)
            axes.set_ylim(*_limits(y))
            if i == 0:
                axes.set_title(clip, fontsize=9)
        places[i, 0].set_ylabel(f"{column}, {_rows(table, clips[0], column)['unit'][0].as_py()}")
    for axes in places[-1]:
        axes.set_xlabel("time, s")
    places[0, 0].legend(frameon=False, fontsize=7)
    figure.tight_layout()
    return svg(figure)


def residual_figure(table: pa.Table) -> str:
    """Residuals of each column over time, without and with the effects."""
    columns = list(dict.fromkeys(table["object"].to_pylist()))[:MOST_SHOWN]
    figure, places = plt.subplots(len(columns), 1, figsize=(8.4, 1.9 * len(columns)), squeeze=False)
    for axes, column in zip(places[:, 0], columns, strict=True):
        rows = table.filter(pc.equal(table["object"], column))
        for kind, colour, label in (("before", COLOURS[1], "calibrated"), ("after", COLOURS[2], "with the effects")):
            axes.plot(rows["time"].to_numpy(), rows[kind].to_numpy(), ".", ms=2, color=colour, label=label)
        axes.axhline(0, color="#444", lw=0.6)
        axes.set_ylabel(f"{column}, {rows['unit'][0].as_py()}")
    places[0, 0].legend(frameon=False, ncols=2, markerscale=4)
    places[-1, 0].set_xlabel("time, s")
    figure.tight_layout()
    return svg(figure)


def _limits(y: np.ndarray) -> tuple[float, float]:
    """What is shown of a column: half as much again as was measured; predictions may diverge."""
    low, high = float(y.min()), float(y.max())
    room = max(high - low, 1e-9) / 4
    return low - room, high + room
