"""CSV files with a header, from and to rows by column name."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def write_rows(
    path: Path, rows: Sequence[Mapping[str, Any]], columns: Sequence[str] | None = None, digits: int = 6
) -> None:
    """Write rows as CSV.

    Args:
        path: The file; its folder is made where it is missing.
        rows: Values by column name. A cell is empty where a row lacks its column.
        columns: The columns to write, in order. Default: every key of any row, in the order of first appearance.
        digits: Significant digits of floats.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    names = list(dict.fromkeys(key for row in rows for key in row)) if columns is None else list(columns)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.{digits}g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def append_row(path: Path, row: Mapping[str, Any]) -> None:
    """Append a row to a log; a new file gets a header from the row's keys first."""
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if file.tell() == 0:
            writer.writeheader()
        writer.writerow(row)


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, all values as text."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
