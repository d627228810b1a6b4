"""Whether measured motion fits what is stated of it: seconds, metres, and the clips that the scene names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.track import Track
from pipeline.errors import MeasurementError, SceneError, did_you_mean

MOST_INTERVAL_S = 1.0  # between two samples, median
MOST_SECONDS = 900.0
MOST_SPAN_M, MOST_SPEED_M_S = 200.0, 300.0
MOST_SIZES, FAST_M_S = 1000.0, 60.0  # a body that moves over so many of its own sizes, and so fast on the median


def check_plausible(tracks: Sequence[Track], known: KnownScene) -> None:
    """Raise MeasurementError, which names the likely unit, for times that cannot be seconds and positions that cannot
    be metres; SceneError for overrides of a clip that was not measured."""
    measured = {track.clip for track in tracks}
    for clip in known.by_clip:
        if clip not in measured:
            some = ", ".join(sorted(measured)[:5]) + ", …" * (len(measured) > 5)
            raise SceneError(
                f"clips.{clip}: no clip of that name was measured{did_you_mean(clip, measured)}; valid: {some}"
            )
    for track in tracks:
        _check_units(track, _size(known, track))


def _size(known: KnownScene, track: Track) -> float:
    """The largest length that is stated of the track's body, m; infinite where the scene lacks it."""
    bodies = {body.name: body for body in known.of_clip(track.clip).objects}
    return max(bodies[track.object].size) if track.object in bodies else np.inf


def _check_units(track: Track, size: float) -> None:
    there = np.isfinite(track.position).all(1)
    time, position = track.time[there], track.position[there]
    if len(time) < 2:
        return
    place = f"clip {track.clip}, object {track.object}"
    interval, seconds = float(np.median(np.diff(time))), float(np.ptp(time))
    if interval > MOST_INTERVAL_S:
        unit = "milliseconds" if interval < 1e3 * MOST_INTERVAL_S else "microseconds or nanoseconds"
        raise MeasurementError(f"{place}: {interval:g} s from sample to sample: is `time` in {unit}? Valid: seconds")
    if seconds > MOST_SECONDS:
        raise MeasurementError(f"{place}: a clip of {seconds:g} s; valid: at most {MOST_SECONDS:g} s")
    span = float(np.ptp(position, axis=0).max())
    speed = float(np.median(np.linalg.norm(np.diff(position, axis=0), axis=1) / np.diff(time)))
    small = span > MOST_SIZES * size and speed > FAST_M_S
    if span > MOST_SPAN_M or speed > MOST_SPEED_M_S or small:
        raise MeasurementError(
            f"{place}: positions over {span:.3g} m at {speed:.3g} m/s: are `x`, `y`, `z` in millimetres or pixels? "
            "Valid: metres"
        )
