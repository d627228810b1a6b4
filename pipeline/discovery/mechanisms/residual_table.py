"""residuals.parquet: every measured number, and its residuals with and without the effects found."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from pipeline.discovery.mechanisms.candidate import Candidate

SCHEMA = pa.schema(
    [
        ("clip", pa.string()),
        ("object", pa.string()),
        ("time", pa.float64()),
        ("unit", pa.string()),
        ("held_out", pa.bool_()),
        ("measured", pa.float64()),
        ("before", pa.float64()),
        ("after", pa.float64()),
    ]
)
"""object: the column of the log. before, after: measured minus predicted, of the calibrated model and of the one with
the verdict's effects."""


def residual_table(before: Candidate, after: Candidate) -> pa.Table:
    """A row for each measured number, in the order of clips, columns and times."""
    problem, parts = before.problem, []
    first, last = (_by_row(c) for c in (before, after))
    for w, window in enumerate(problem.windows):
        clip = problem.log.clips[window.clip]
        stop = window.rows.stop if window.ahead is None else window.ahead.stop
        rows = np.arange(window.rows.start, stop)
        for c, channel in enumerate(problem.log.channels):
            y = clip.values[rows, c]
            there = np.isfinite(y)
            count = int(there.sum())
            held = window.held | (rows[there] >= window.rows.stop)
            parts.append(
                pa.table(
                    [
                        pa.array([clip.name] * count, pa.string()),
                        pa.array([channel.column] * count, pa.string()),
                        pa.array(clip.time[rows[there]]),
                        pa.array([channel.unit] * count, pa.string()),
                        pa.array(np.broadcast_to(held, count)),
                        pa.array(y[there]),
                        pa.array(first[w, c]),
                        pa.array(last[w, c]),
                    ],
                    schema=SCHEMA,
                )
            )
    return pa.concat_tables(parts).sort_by([("clip", "ascending"), ("object", "ascending"), ("time", "ascending")])


def _by_row(found: Candidate) -> dict[tuple[int, int], np.ndarray]:
    """(window, column) -> residuals in the column's unit, with those of the forecast."""
    problem, out = found.problem, {}
    ahead = dict(zip(problem.ahead, found.fit.ahead, strict=True))
    for w in range(len(problem.windows)):
        which = problem.columns(w)
        for c in range(len(problem.log.channels)):
            left = found.fit.residual[w][which == c]
            if w in ahead:
                left = np.concatenate([left, ahead[w].residual[ahead[w].columns == c]])
            out[w, c] = left * problem.sigma[c]
    return out
