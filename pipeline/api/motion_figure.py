"""The plot of measured motion beside the replay: place, speed and energy against time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.api.line_plot import Panel, Series, draw_panels
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
    names = [o.name for o in scene.objects]
    colours = {t.name: object_colour(names.index(t.name)) for t in tracks}
    shown: list[list[Series]] = [[] for _ in PANELS]
    for track in tracks:
        for position, dots in ((track.replayed, False), (track.position, True)):
            speed = speeds(track.times, position)
            energy = 0.5 * speed**2 - position @ np.array(scene.gravity)
            for panel, values in zip(shown, (*position.T, speed, energy), strict=True):
                panel.append(Series(track.times, values, colours[track.name], dots))
    ways = [np.ptp(np.concatenate([s.y for s in panel])) if panel else 0.0 for panel in shown[:3]]
    least = [LEAST_SHARE * max(ways)] * 3 + [0.0, 0.0]
    panels = [Panel(name, tuple(s), width) for name, s, width in zip(PANELS, shown, least, strict=True)]
    title = f"dots: measured; lines: replay; scale by {metric}"
    Image.fromarray(draw_panels(panels, title, list(colours.items()), "time, s")).save(path)


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
