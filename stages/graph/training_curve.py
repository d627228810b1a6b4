"""How a training went, as a CSV file that DVC plots."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def write_curve(path: Path, rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Write `step` and the columns of the rows that have all of them."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["step", *columns])
        writer.writerows(
            [row["step"], *(round(row[c], 6) for c in columns)] for row in rows if row.keys() >= {*columns}
        )
