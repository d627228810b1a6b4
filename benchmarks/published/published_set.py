"""A published set, and the folder of all sets: `DYNAMICS_DATA`, else ../shared/data beside the project."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.discrepancy.tracks.track import Track

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class RealSet:
    """A published set of measurements.

    Attributes:
        name: Of the set.
        tracks: Measured motion.
        known: The content of the scene file.
        source: Repository.
        licence: Of the data.
    """

    name: str
    tracks: tuple[Track, ...]
    known: dict[str, Any]
    source: str
    licence: str


def real_motion_folder() -> Path | None:
    """The folder that holds ball_drops, cube_tosses and table_tennis; None if there is none."""
    base = Path(os.environ.get("DYNAMICS_DATA", ROOT.parent / "shared" / "data"))
    folder = base / "real_motion"
    return folder if folder.is_dir() else None
