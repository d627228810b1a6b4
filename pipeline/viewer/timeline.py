"""The two timelines of each recording: `frame`, counted from 0, and `sim_time`, in seconds.

Motion is logged at each simulation step on `sim_time`, for slow motion, and at each frame on `frame`. Pictures are
logged at frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import rerun as rr

FRAME, SIM_TIME = "frame", "sim_time"


def at_times(times: np.ndarray, fps: float) -> list[rr.TimeColumn]:
    """Both timelines for rows at times (R,) s. The frame of a row is the one shown at that time."""
    return [
        rr.TimeColumn(FRAME, sequence=np.floor(times * fps + 1e-6).astype(np.int64)),
        rr.TimeColumn(SIM_TIME, duration=np.asarray(times, np.float64)),
    ]


def at_frames(frames: np.ndarray, fps: float) -> list[rr.TimeColumn]:
    """Both timelines for rows at frame numbers (R,)."""
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
    """Log rows at simulation steps. Steps between two frames are on `sim_time` only.

    Args:
        recording: The recording.
        path: The entity.
        times: (S,) of the steps, s.
        fps: Frames per second.
        columns: Makes the columns of the rows with given indices.
    """
    place = times * fps
    on_frame = np.abs(place - np.rint(place)) < 1e-6
    shown, between = np.flatnonzero(on_frame), np.flatnonzero(~on_frame)
    recording.send_columns(path, at_frames(np.rint(place[shown]), fps), columns(shown), strict=True)
    if len(between):
        recording.send_columns(path, [rr.TimeColumn(SIM_TIME, duration=times[between])], columns(between), strict=True)
