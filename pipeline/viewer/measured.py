"""Measured motion beside the predictions of two models, as a rerun recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.recording import save_recording
from pipeline.viewer.residuals import layout, log_verdict, tracks

KINDS = {"measured": (60, 60, 60), "baseline": (245, 133, 24), "augmented": (84, 162, 75)}


def save_measured(table: pa.Table, name: str, notes: str, path: Path) -> None:
    """Write a recording of measured and predicted positions, under world/<clip>/<object>/<kind>.

    Args:
        table: Residuals, from `pipeline.discovery.report.residual_table`.
        name: Name and id of the recording.
        notes: Markdown.
        path: The file.

    Raises:
        OutputError: The file cannot be written.
    """
    view = rrb.Spatial3DView(origin="world", name="clips")
    plots = rrb.TimeSeriesView(origin="residual", name="residual, m")
    save_recording(name, layout(view, plots), lambda recording: _log(recording, table, notes), path)


def _log(recording: rr.RecordingStream, table: pa.Table, notes: str) -> None:
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_verdict(recording, notes)
    measured, before, after = (
        np.stack([table[f"{kind}_{a}"].to_numpy() for a in "xyz"], 1) for kind in ("measured", "before", "after")
    )
    shown = {"measured": measured, "baseline": measured - before, "augmented": measured - after}
    for track in tracks(table):
        rows, times = track.rows, track.times
        for kind, colour in KINDS.items():
            place = f"world/{track.place}/{kind}"
            recording.log(
                f"{place}/path", rr.LineStrips3D([shown[kind][rows]], colors=[(*colour, 120)], radii=0.002), static=True
            )
            recording.log(place, rr.Points3D.from_fields(colors=[colour], radii=[0.012]), static=True)
            recording.send_columns(place, times, rr.Points3D.columns(positions=shown[kind][rows]))
        for kind, residual in (("baseline", before), ("augmented", after)):
            size = np.linalg.norm(residual[rows], axis=1)
            recording.send_columns(f"residual/{kind}/{track.place}", times, rr.Scalars.columns(scalars=size))
