"""The plot of measured motion beside the replay: place, speed and energy against time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.inference.body_tracks import BodyTrack
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import object_colour

PANELS = ("x, m", "y, m", "z, m", "speed, m/s", "energy, J/kg")
LEAST_SHARE = 0.1  # of the longest way along one axis, that each axis shows at least
SMOOTH = 5  # samples of the quadratic that gives a measured speed


def write_motion_figure(path: Path, tracks: list[BodyTrack], scene: Scene, metric: str) -> None:
    """Write a PNG: dots are measured, lines the replay's.

    Args:
        path: The file.
        tracks: Of the scene's bodies.
        scene: The answer, whose gravity gives the energy.
        metric: What fixed the scale, for the title.
    """
    figure = Figure(figsize=(7, 9), layout="constrained")
    axes = figure.subplots(len(PANELS), 1, sharex=True)
    names = [o.name for o in scene.objects]
    for track in tracks:
        colour = tuple(c / 255 for c in object_colour(names.index(track.name)))
        for series, style in ((track.position, {"ls": "", "marker": ".", "ms": 4}), (track.replayed, {"lw": 1.2})):
            speed = speeds(track.times, series)
            energy = 0.5 * speed**2 - series @ np.array(scene.gravity)
            for axis, values in zip(axes, (*series.T, speed, energy), strict=True):
                axis.plot(track.times, values, color=colour, **style)
        axes[0].plot([], [], color=colour, label=track.name)
    ways = [axis.dataLim.height for axis in axes[:3]]
    for axis in axes[:3]:
        low, high = axis.dataLim.intervaly
        half = max(0.55 * (high - low), 0.5 * LEAST_SHARE * max(ways))
        if np.isfinite(half) and half > 0:
            axis.set_ylim(0.5 * (low + high) - half, 0.5 * (low + high) + half)
    for axis, label in zip(axes, PANELS, strict=True):
        axis.set_ylabel(label)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_title(f"dots: measured; lines: replay; scale by {metric}", fontsize=10, loc="left")
    axes[0].legend(frameon=False, ncols=max(len(tracks), 1), fontsize=9)
    axes[-1].set_xlabel("time, s")
    figure.savefig(path, dpi=110)


def speeds(times: np.ndarray, position: np.ndarray) -> np.ndarray:
    """(T,) m/s of positions (T, 3) m, by a quadratic through the nearest SMOOTH samples."""
    out = np.zeros(len(times))
    half = SMOOTH // 2
    for k in range(len(times)):
        near = slice(max(0, min(k - half, len(times) - SMOOTH)), max(k + half + 1, SMOOTH))
        t = times[near] - times[k]
        degree = min(2, len(t) - 1)
        if degree:
            out[k] = np.linalg.norm(np.polyfit(t, position[near], degree)[-2])
    return out
