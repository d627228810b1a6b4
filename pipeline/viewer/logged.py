"""The log of a mechanism beside the predictions of two models, as a rerun recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.recording import save_recording
from pipeline.viewer.timeline import SIM_TIME


def save_logged(table: pa.Table, name: str, notes: str, path: Path) -> None:
    """Write a recording of measured and predicted columns, under motion/<clip>/<column>/<kind>, and of what is left.

    Args:
        table: Residuals, from `pipeline.mechanisms.residual_table`.
        name: Name and id of the recording.
        notes: Markdown.
        path: The file.

    Raises:
        OutputError: The file cannot be written.
    """
    motion, left = rrb.TimeSeriesView(origin="motion", name="motion"), rrb.TimeSeriesView(origin="residual")
    text = rrb.TextDocumentView(origin="notes", name="verdict")
    layout = rrb.Blueprint(rrb.Vertical(motion, rrb.Horizontal(left, text), row_shares=[3, 1]))
    save_recording(name, layout, lambda recording: _log(recording, table, notes), path)


def _log(recording: rr.RecordingStream, table: pa.Table, notes: str) -> None:
    recording.log("notes", rr.TextDocument(notes, media_type="text/markdown"), static=True)
    clip, column = (np.array(table[k].to_pylist()) for k in ("clip", "object"))
    time, measured, before, after = (table[k].to_numpy() for k in ("time", "measured", "before", "after"))
    series = {
        "motion/{}/measured": measured,
        "motion/{}/calibrated": measured - before,
        "motion/{}/augmented": measured - after,
        "residual/{}/calibrated": before,
        "residual/{}/augmented": after,
    }
    for c, o in dict.fromkeys(zip(clip.tolist(), column.tolist(), strict=True)):
        rows = (clip == c) & (column == o)
        times = [rr.TimeColumn(SIM_TIME, duration=time[rows])]
        for place, values in series.items():
            recording.send_columns(place.format(f"{c}/{o}"), times, rr.Scalars.columns(scalars=values[rows]))
