"""What recordings of measurements and two models share: their layout, the verdict, and a place for each track."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.timeline import SIM_TIME

NOTES = "notes"


@dataclass(frozen=True)
class ShownTrack:
    """One object, or one column, in one clip.

    Attributes:
        place: Its path below an entity, "<clip>/<object>".
        rows: Of the table, bool.
        times: Of these rows.
    """

    place: str
    rows: np.ndarray
    times: list[rr.TimeColumn]


def layout(view: rrb.View, residuals: rrb.View) -> rrb.Blueprint:
    """A view of the motion above one of the residuals and the verdict."""
    verdict = rrb.TextDocumentView(origin=NOTES, name="verdict")
    return rrb.Blueprint(rrb.Vertical(view, rrb.Horizontal(residuals, verdict), row_shares=[3, 1]))


def log_verdict(recording: rr.RecordingStream, text: str) -> None:
    """Log the verdict, Markdown."""
    recording.log(NOTES, rr.TextDocument(text, media_type="text/markdown"), static=True)


def tracks(table: pa.Table) -> Iterator[ShownTrack]:
    """The tracks of a table of residuals, with the columns clip, object and time (s)."""
    clip, body = (np.array(table[k].to_pylist()) for k in ("clip", "object"))
    time = table["time"].to_numpy()
    for c, o in dict.fromkeys(zip(clip.tolist(), body.tolist(), strict=True)):
        rows = (clip == c) & (body == o)
        place = "/".join(map(rr.escape_entity_path_part, (c, o)))
        yield ShownTrack(place, rows, [rr.TimeColumn(SIM_TIME, duration=time[rows])])
