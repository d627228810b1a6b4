"""Measured motion of a file: in the project's own format, or in a table as people have them (`tables`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.discovery.tables.motion_table import read_motion_table
from pipeline.discovery.tables.said import Said
from pipeline.discovery.tables.text_file import first_line
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.track import NEEDED, Track, read_tracks, tracks_of
from pipeline.scene.solid import reach_below


@dataclass(frozen=True)
class MeasuredFile:
    """What was measured.

    Attributes:
        tracks: One for each clip and object.
        known: The scene, without a ground where the heights of the table tell nothing of it.
        notes: What was assumed of the table, a line each.
    """

    tracks: list[Track]
    known: KnownScene
    notes: tuple[str, ...] = ()


def read_measured(path: Path, known: KnownScene, said: Said) -> MeasuredFile:
    """Read a file of measured motion.

    Args:
        path: In the format of docs/formats.md, or any table, workbook or project of Tracker.
        known: The scene whose objects it shows.
        said: What the user says of a table.

    Returns:
        The tracks, and what was assumed.

    Raises:
        MeasurementError: That names the place of a fault, and what is needed.
        ParamsError: For what the user says that the table does not have.
    """
    if said == Said() and _is_own_format(path):
        return MeasuredFile(read_tracks(path), known)
    ground = known.scene.ground or 0.0
    bodies = {o.name: ground + (0.0 if o.shape == "mesh" else reach_below(o)) for o in known.scene.objects}
    table = read_motion_table(path, bodies, said)
    tracks = tracks_of(table.rows, path)
    if table.own_heights and known.scene.ground is not None and _is_below(tracks, bodies, ground):
        note = (
            "bodies are below the ground of the scene, so that heights are from an origin of their own: there is "
            "no ground, unless the scene says `ground: {height: …}`"
        )
        scenes = {clip: replace(scene, ground=None) for clip, scene in known.by_clip.items()}
        known = replace(known, scene=replace(known.scene, ground=None), by_clip=scenes)
        return MeasuredFile(tracks, known, (*table.notes, note))
    return MeasuredFile(tracks, known, table.notes)


def _is_own_format(path: Path) -> bool:
    """Whether a file is Parquet, or CSV whose header has all columns of the format."""
    if path.suffix == ".parquet":
        return True
    header = first_line(path)
    return path.suffix == ".csv" and set(NEEDED) <= {name.strip().strip('"') for name in header.split(",")}


def _is_below(tracks: list[Track], bodies: dict[str, float], ground: float) -> bool:
    """Whether a body is in the ground by more than half of its reach."""
    return any(np.nanmin(t.position[:, 2]) < (bodies.get(t.object, ground) + ground) / 2 for t in tracks)
