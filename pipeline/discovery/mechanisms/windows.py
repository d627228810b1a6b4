"""The log cut into windows, each with an initial state of its own, and a first guess of these states."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discovery.mechanisms.log import Clip, Log, Quantity
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.discovery.mechanisms.simulation import States, Window
from pipeline.errors import MeasurementError

GUESS_ROWS = 7  # samples from which a position and a velocity are guessed
LEAST_ROWS = 8  # of a window
FACTOR = 2  # by which windows of the next level are shorter
MOST_LEVELS = 9


def halves(log: Log, held_out: float, rng: np.random.Generator) -> list[tuple[int, slice, bool]]:
    """Which rows of which clips are fitted (False) and held out (True).

    Of several clips some are held out; of one clip, its end, of which the longest windows make a forecast.
    """
    clips = log.clips
    if held_out == 0:
        return [(k, slice(0, len(c.time)), False) for k, c in enumerate(clips)]
    if len(clips) > 1:
        count = min(max(round(held_out * len(clips)), 1), len(clips) - 1)
        held = set(rng.permutation(len(clips))[:count].tolist())
        return [(k, slice(0, len(c.time)), k in held) for k, c in enumerate(clips)]
    time = clips[0].time
    cut = int(np.searchsorted(time, time[0] + (1 - held_out) * (time[-1] - time[0])))
    if min(cut, len(time) - cut) < LEAST_ROWS:
        raise MeasurementError(f"the only clip has {len(time)} rows: too few to hold out {held_out:.0%} of its time")
    return [(0, slice(0, cut), False), (0, slice(cut, len(time)), True)]


def levels(log: Log, parts: Sequence[tuple[int, slice, bool]], own: int) -> list[tuple[Window, ...]]:
    """The log cut into windows: whole parts first, then half as long, and so on.

    The end of the only clip is forecast from the state in which the rest of it began.

    Each window begins where one of the level before begins, or inside of it. A window has several times as many
    numbers as its initial state.

    Args:
        log: The log.
        parts: Of `halves`.
        own: Numbers of an initial state.
    """
    columns = max(sum(np.isfinite(c.values).mean() for c in log.clips) / len(log.clips) * len(log.channels), 1.0)
    least = max(LEAST_ROWS, int(np.ceil(2 * own / columns)))
    out: list[tuple[Window, ...]] = []
    for level in range(MOST_LEVELS):
        cut: list[Window] = []
        for clip, rows, held in parts:
            count = rows.stop - rows.start
            pieces = int(np.clip(FACTOR**level, 1, max(count // least, 1)))
            pieces = FACTOR ** int(np.log(pieces) / np.log(FACTOR) + 1e-9)
            edges = np.linspace(rows.start, rows.stop, pieces + 1).astype(int)
            cut += [Window(clip, slice(a, b), held) for a, b in itertools.pairwise(edges.tolist())]
        if level == 0 and len(log.clips) == 1 and len(cut) == 2:
            whole, end = cut
            cut = [replace(whole, ahead=end.rows)]
        if out and len(cut) == len(out[-1]):
            break
        out.append(tuple(cut))
    return out


def guessed_states(mechanism: Mechanism, log: Log, windows: Sequence[Window]) -> States:
    """The states at the beginnings of windows, from polynomials through their first measurements.

    Joints that were not measured begin at rest.
    """
    model = mechanism.model
    position = np.tile(mechanism.rest, (len(windows), 1))
    velocity = np.zeros((len(windows), model.nv))
    activation = np.zeros((len(windows), model.na))
    for w, window in enumerate(windows):
        clip = log.clips[window.clip]
        for joint in mechanism.joints:
            column, rate = log.column(Quantity.JOINT, joint.name), log.column(Quantity.VELOCITY, joint.name)
            if column is not None:
                q, v = _first(clip, window, column)
                position[w, joint.position], velocity[w, joint.velocity] = q, v
            if rate is not None:
                velocity[w, joint.velocity] = _first(clip, window, rate)[0]
    return States(position, velocity, activation)


def _first(clip: Clip, window: Window, column: int) -> tuple[float, float]:
    """Value and rate of a column at the beginning of a window."""
    t, y = clip.time[window.rows], clip.values[window.rows, column]
    there = np.flatnonzero(np.isfinite(y))[:GUESS_ROWS]
    if len(there) < 2:
        return (float(y[there[0]]), 0.0) if len(there) else (0.0, 0.0)
    scale = max(float(t[there[-1]] - t[0]), 1e-9)
    fit = np.polynomial.polynomial.polyfit((t[there] - t[0]) / scale, y[there], min(3, len(there) - 1))
    return float(fit[0]), float(fit[1] / scale)
