"""The two timelines of every recording: `frame`, counted from 0, and `sim_time`, in seconds.

What moves is logged at every simulation step of `sim_time`, so that it can be watched in slow motion, and at the
frames of `frame`; pictures are logged at frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import rerun as rr

FRAME, SIM_TIME = "frame", "sim_time"


def at_times(times: np.ndarray, fps: float) -> list[rr.TimeColumn]:
    """Both timelines for rows at `times`, s; a row belongs to the frame that is being shown then."""
    return [
        rr.TimeColumn(FRAME, sequence=np.floor(times * fps + 1e-6).astype(np.int64)),
        rr.TimeColumn(SIM_TIME, duration=np.asarray(times, np.float64)),
    ]


def at_frames(frames: np.ndarray, fps: float) -> list[rr.TimeColumn]:
    """Both timelines for rows at frame numbers."""
    return [
        rr.TimeColumn(FRAME, sequence=np.asarray(frames, np.int64)),
        rr.TimeColumn(SIM_TIME, duration=np.asarray(frames, np.float64) / fps),
    ]


def send_steps(
    recording: rr.RecordingStream,
    path: str,
    times: np.ndarray,
    fps: float,
    columns: Callable[[np.ndarray], rr.ComponentColumnList],
) -> None:
    """Send rows at simulation steps. columns: the columns of the rows with the given indices.

    Steps between two frames are on `sim_time` alone, so that `frame` shows what the camera saw.
    """
    place = times * fps
    on_frame = np.abs(place - np.rint(place)) < 1e-6
    shown, between = np.flatnonzero(on_frame), np.flatnonzero(~on_frame)
    recording.send_columns(path, at_frames(np.rint(place[shown]), fps), columns(shown), strict=True)
    if len(between):
        recording.send_columns(path, [rr.TimeColumn(SIM_TIME, duration=times[between])], columns(between), strict=True)
