"""A published set, and the folder of all sets: `DYNAMICS_DATA`, else ../shared/data beside the project."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.discovery.tracks.track import Track
from training.data_folder import data_folder


@dataclass(frozen=True)
class RealSet:
    """A published set of measurements.

    Attributes:
        name: Of the set.
        tracks: Measured motion.
        known: The content of the scene file.
    """

    name: str
    tracks: tuple[Track, ...]
    known: dict[str, Any]


def real_motion_folder() -> Path | None:
    """The folder that holds ball_drops, cube_tosses and table_tennis; None if there is none."""
    folder = data_folder() / "real_motion"
    return folder if folder.is_dir() else None
