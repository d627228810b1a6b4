"""Data that the project does not ship."""

from __future__ import annotations

import os
from pathlib import Path


def data_folder() -> Path:
    """DYNAMICS_DATA, else `shared/data` beside the repository. It need not exist."""
    return Path(os.environ.get("DYNAMICS_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def needed(name: str) -> Path:
    """A folder of these data; raises SystemExit where it is missing."""
    if not (folder := data_folder() / name).is_dir():
        raise SystemExit(f"error: no folder {folder}; set DYNAMICS_DATA to the folder that has {name}")
    return folder
