"""The two timelines of each recording: `frame`, counted from 0, and `sim_time`, in seconds.

Motion is logged at each simulation step on `sim_time`, for slow motion, and at each frame on `frame`. Pictures are
logged at frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import rerun as rr

FRAME, SIM_TIME = "frame", "sim_time"


def at_times(times: np.ndarray, clock: np.ndarray) -> list[rr.TimeColumn]:
    """Both timelines for rows at times (R,) s; clock: (F,) s, of the frames. A row has the frame shown at its time."""
    return [
        rr.TimeColumn(FRAME, sequence=np.maximum(np.searchsorted(clock, times + 1e-6, "right") - 1, 0)),
        rr.TimeColumn(SIM_TIME, duration=np.asarray(times, np.float64)),
    ]


def at_frames(frames: np.ndarray, clock: np.ndarray) -> list[rr.TimeColumn]:
    """Both timelines for rows at frame numbers (R,); clock: (F,) s, of the frames."""
    return [
        rr.TimeColumn(FRAME, sequence=np.asarray(frames, np.int64)),
        rr.TimeColumn(SIM_TIME, duration=np.asarray(clock, np.float64)[frames]),
    ]


def send_steps(
    recording: rr.RecordingStream,
    path: str,
    times: np.ndarray,
    clock: np.ndarray,
    columns: Callable[[np.ndarray], rr.ComponentColumnList],
) -> None:
    """Log rows at simulation steps. Steps between two frames are on `sim_time` only.

    Args:
        recording: The recording.
        path: The entity.
        times: (S,) of the steps, s.
        clock: (F,) s, of the frames.
        columns: Makes the columns of the rows with given indices.
    """
    frames = np.flatnonzero(clock <= times[-1] + 0.5 * (times[1] - times[0]))
    shown = np.abs(times - clock[frames, None]).argmin(1)
    between = np.setdiff1d(np.arange(len(times)), shown)
    recording.send_columns(path, at_frames(frames, clock), columns(shown), strict=True)
    if len(between):
        recording.send_columns(path, [rr.TimeColumn(SIM_TIME, duration=times[between])], columns(between), strict=True)
