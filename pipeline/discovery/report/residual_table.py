"""residuals.parquet: every measured position, and its residuals with and without the effects found."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from pipeline.discovery.fitting.candidate import residuals_m
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.localisation import regime_of

SCHEMA = pa.schema(
    [
        ("clip", pa.string()),
        ("object", pa.string()),
        ("time", pa.float64()),
        ("regime", pa.string()),
        ("arc", pa.int64()),
        ("held_out", pa.bool_()),
        ("used", pa.bool_()),
    ]
    + [(f"{kind}_{axis}", pa.float64()) for kind in ("measured", "before", "after") for axis in "xyz"]
)
"""measured: m. before, after: residuals, m, of the calibrated model and of the one with the verdict's effects; 0 for z
on the ground. used: False for outliers."""


def residual_table(found: Discovery) -> pa.Table:
    """A row for each sample of each arc, in the order of clips, objects and times."""
    problem, baseline, names = (
        found.problem,
        found.selection.baseline,
        [o.name for o in found.problem.known.scene.objects],
    )
    rows = []
    before = residuals_m(problem, baseline)
    split = found.answer.problem is not problem
    after = before if split else residuals_m(problem, found.answer)
    lookup = _split_residuals(found) if split else {}
    for number, stack in enumerate(problem.stacks):
        fit = baseline.fit
        _, nodes = run(stack, fit.model, fit.theta[None], fit.starts[number][None])
        for i in range(len(stack)):
            arc = problem.arcs[stack.index[i]]
            for k, time in enumerate(arc.time):
                node = int(stack.time[i, k] / max(stack.duration[i], 1e-9) * stack.steps)
                regime = regime_of(stack, i, nodes.velocity[0, i, node], nodes.angular_velocity[0, i, node])
                left = after[number][i, k]
                if split:
                    left = lookup.get((arc.clip, arc.object, int(arc.row[k])), np.full(3, np.nan))
                rows.append(
                    (
                        arc.clip,
                        names[arc.object],
                        float(time),
                        str(regime),
                        int(stack.index[i]),
                        arc.clip in problem.held_out,
                        bool(stack.weight[i, k].max() > 0),
                        *map(float, arc.position[k]),
                        *map(float, before[number][i, k]),
                        *map(float, left),
                    )
                )
    rows.sort(key=lambda r: (r[0], r[1], r[2]))
    return pa.table([pa.array(c, f.type) for c, f in zip(zip(*rows, strict=True), SCHEMA, strict=True)], schema=SCHEMA)


def _split_residuals(found: Discovery) -> dict[tuple[str, int, int], np.ndarray]:
    """(clip, object, row) -> residual of the answer, whose arcs were split at hits."""
    problem = found.answer.problem
    out = {}
    for stack, rows in zip(problem.stacks, residuals_m(problem, found.answer), strict=True):
        for i in range(len(stack)):
            arc = problem.arcs[stack.index[i]]
            for k, row in enumerate(arc.row):
                out[arc.clip, arc.object, int(row)] = rows[i, k]
    return out
