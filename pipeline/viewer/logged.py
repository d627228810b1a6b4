"""The log of a mechanism beside the predictions of two models, as a rerun recording."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.recording import save_recording
from pipeline.viewer.residuals import layout, log_verdict, tracks


def save_logged(table: pa.Table, name: str, notes: str, path: Path) -> None:
    """Write a recording of measured and predicted columns, under motion/<clip>/<column>/<kind>, and of what is left.

    Args:
        table: Residuals, from `pipeline.discovery.mechanisms.residual_table`.
        name: Name and id of the recording.
        notes: Markdown.
        path: The file.

    Raises:
        OutputError: The file cannot be written.
    """
    motion, left = rrb.TimeSeriesView(origin="motion", name="motion"), rrb.TimeSeriesView(origin="residual")
    save_recording(name, layout(motion, left), lambda recording: _log(recording, table, notes), path)


def _log(recording: rr.RecordingStream, table: pa.Table, notes: str) -> None:
    log_verdict(recording, notes)
    measured, before, after = (table[k].to_numpy() for k in ("measured", "before", "after"))
    series = {
        "motion/{}/measured": measured,
        "motion/{}/calibrated": measured - before,
        "motion/{}/augmented": measured - after,
        "residual/{}/calibrated": before,
        "residual/{}/augmented": after,
    }
    for track in tracks(table):
        for place, values in series.items():
            scalars = rr.Scalars.columns(scalars=values[track.rows])
            recording.send_columns(place.format(track.place), track.times, scalars)
