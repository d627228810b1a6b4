"""Speed and height of every object over time, and the events as a log."""

from __future__ import annotations

import numpy as np
import rerun as rr

from pipeline.viewer.event_text import event_text
from pipeline.viewer.footage import Motion
from pipeline.viewer.timeline import at_times, send_steps
from pipeline.vision.rendering.appearance import object_colour

PLOTS = {"speed": "speed, m/s", "height": "height above the ground, m"}


def log_plots(recording: rr.RecordingStream, motion: Motion, fps: float) -> None:
    """Scalars under plots/speed/<motion>/<object> and plots/height/<motion>/<object>."""
    trace = motion.trace
    values = {
        "speed": np.linalg.norm(trace.velocity, axis=-1),
        "height": trace.position[..., 2] - (motion.scene.ground or 0.0),
    }
    for plot, table in values.items():
        for i, obj in enumerate(motion.scene.objects):
            path = f"plots/{plot}/{motion.name}/{obj.name}"
            look = rr.SeriesLines(colors=[object_colour(i)], names=[f"{obj.name} ({motion.name})"],
                                  widths=[2.0 if motion.solid else 1.0])  # fmt: skip
            recording.log(path, look, static=True, strict=True)

            def scalars(rows: np.ndarray, series: np.ndarray = table[:, i]) -> rr.ComponentColumnList:
                return rr.Scalars.columns(scalars=series[rows])

            send_steps(recording, path, trace.times, fps, scalars)


def log_events(recording: rr.RecordingStream, motion: Motion, fps: float, named: bool) -> None:
    """A line of text for each event, under events/<motion>; `named`: with the motion's name before it."""
    if not motion.events:
        return
    columns = rr.TextLog.columns(
        text=[f"{motion.name}: " * named + event_text(e, motion.scene) for e in motion.events],
        level=["INFO"] * len(motion.events),
        color=[object_colour(e.first) for e in motion.events],
    )
    times = at_times(np.array([e.time for e in motion.events]), fps)
    recording.send_columns(f"events/{motion.name}", times, columns, strict=True)
