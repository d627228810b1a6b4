"""Balls dropped from a 48 m bridge: heights at 15 Hz, two drops each
(github.com/briandesilva/discovery-of-physics-from-data, MIT).

The sheet is OOXML although it is named .xls. Where a ball's weight is not given (??), a usual one is assumed.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.published.published_set import RealSet
from pipeline.discovery.tracks.track import Track

OUNCE = 0.0283495  # kg
USUAL = {"volleyball": (9.5, 66.0)}  # ounces, cm around


def read_ball_drops(folder: Path) -> list[RealSet]:
    """One set for each ball. folder: real_motion/ball_drops."""
    import openpyxl  # of the extra `benchmark`

    sizes = _sizes(folder / "data" / "balls.txt")
    data = (folder / "data" / "Ball_drops_data.xls").read_bytes()
    book = openpyxl.load_workbook(io.BytesIO(data), data_only=True)
    out = []
    for sheet in book:
        rows = [r[:3] for r in sheet.iter_rows(min_row=2, values_only=True) if r[0] is not None and r[2] is not None]
        values = np.array(rows, float)
        key = sheet.title.lower().replace(" ", "")
        name = next((k for k in sizes if _same(k, key)), None)
        mass, radius = sizes[name] if name else (0.3, 0.1)
        tracks = []
        for drop in np.unique(values[:, 0]):
            mine = values[values[:, 0] == drop]
            position = np.column_stack([np.zeros((len(mine), 2)), mine[:, 2]])
            tracks.append(Track(f"drop_{int(drop)}", "ball", mine[:, 1], position))
        known = {"ground": None, "objects": [{"name": "ball", "shape": "sphere", "radius": radius, "mass": mass}]}
        out.append(RealSet(key, tuple(tracks), known))
    return out


def together(sets: Sequence[RealSet]) -> RealSet:
    """All balls as one set: they fell beside one camera, ruler and clock."""
    tracks, objects = [], []
    for real in sets:
        tracks += [replace(t, clip=f"{real.name}_{t.clip}", object=real.name) for t in real.tracks]
        objects.append({**real.known["objects"][0], "name": real.name})
    return RealSet("balls_together", tuple(tracks), {"ground": None, "objects": objects})


def _same(name: str, sheet: str) -> bool:
    words = {"wiffle": "whiffle"}
    name = name.lower()
    for old, new in words.items():
        name = name.replace(old, new)
    return name.rstrip("s") in (sheet, sheet.removesuffix("ball"), sheet.replace("ball", "")) or name == sheet


def _sizes(path: Path) -> dict[str, tuple[float, float]]:
    """Name of a ball -> mass, kg, and radius, m."""
    out = {}
    for line in path.read_text().splitlines()[1:]:
        parts = line.split()
        if len(parts) == 3:
            usual = USUAL.get(parts[0], (8.0, 60.0))
            ounces, around = (u if word == "??" else float(word) for u, word in zip(usual, parts[1:], strict=True))
            out[parts[0]] = (ounces * OUNCE, around / 200 / np.pi)
    return out
