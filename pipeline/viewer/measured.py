"""Measured motion beside the predictions of two models, as a rerun recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.recording import save_recording
from pipeline.viewer.timeline import SIM_TIME

KINDS = {"measured": (60, 60, 60), "baseline": (245, 133, 24), "augmented": (84, 162, 75)}


def save_measured(table: pa.Table, name: str, notes: str, path: Path) -> None:
    """Write a recording of measured and predicted positions, under world/<clip>/<object>/<kind>.

    Args:
        table: Residuals, from `pipeline.discrepancy.residual_table`.
        name: Name and id of the recording.
        notes: Markdown.
        path: The file.

    Raises:
        OutputError: The file cannot be written.
    """
    view = rrb.Spatial3DView(origin="world", name="clips")
    plots = rrb.TimeSeriesView(origin="residual", name="residual, m")
    text = rrb.TextDocumentView(origin="notes", name="verdict")
    layout = rrb.Blueprint(rrb.Vertical(view, rrb.Horizontal(plots, text), row_shares=[3, 1]))
    save_recording(name, layout, lambda recording: log_measured(recording, table, notes), path)


def log_measured(recording: rr.RecordingStream, table: pa.Table, notes: str) -> None:
    """Log the positions and residuals of a table of residuals, and notes in Markdown."""
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("notes", rr.TextDocument(notes, media_type="text/markdown"), static=True)
    clip, body = (np.array(table[k].to_pylist()) for k in ("clip", "object"))
    time = table["time"].to_numpy()
    measured, before, after = (
        np.stack([table[f"{kind}_{a}"].to_numpy() for a in "xyz"], 1) for kind in ("measured", "before", "after")
    )
    shown = {"measured": measured, "baseline": measured - before, "augmented": measured - after}
    for c, o in dict.fromkeys(zip(clip.tolist(), body.tolist(), strict=True)):
        rows = (clip == c) & (body == o)
        times = [rr.TimeColumn(SIM_TIME, duration=time[rows])]
        where = "/".join(map(rr.escape_entity_path_part, (c, o)))
        for kind, colour in KINDS.items():
            place = f"world/{where}/{kind}"
            recording.log(
                f"{place}/path", rr.LineStrips3D([shown[kind][rows]], colors=[(*colour, 120)], radii=0.002), static=True
            )
            recording.log(place, rr.Points3D.from_fields(colors=[colour], radii=[0.012]), static=True)
            recording.send_columns(place, times, rr.Points3D.columns(positions=shown[kind][rows]))
        for kind, residual in (("baseline", before), ("augmented", after)):
            size = np.linalg.norm(residual[rows], axis=1)
            recording.send_columns(f"residual/{kind}/{where}", times, rr.Scalars.columns(scalars=size))
