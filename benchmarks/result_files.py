"""A benchmark's results as files: a table to read, and a row of a CSV file for each thing that was tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd


def write_results(folder: Path, name: str, title: str, command: str, table: str, rows: Sequence[Any] = ()) -> None:
    """Write `name`.md, and `name`.csv where there are rows.

    Args:
        folder: Is made where it does not exist.
        name: Of both files.
        title: Of the table.
        command: That made it.
        table: As Markdown.
        rows: Data classes, one for each row of the CSV file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if rows:
        pd.DataFrame([asdict(r) for r in rows]).to_csv(folder / f"{name}.csv", index=False)
    (folder / f"{name}.md").write_text(f"# {title}\n\n`{command}`\n\n{table}", encoding="utf-8")
