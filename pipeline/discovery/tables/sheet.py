"""A sheet of cells, and how it falls into blocks of a header and rows of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

MISSING = {"", "-", "--", ".", "?", "nan", "na", "n/a", "#n/a", "null", "none"}


@dataclass(frozen=True)
class Sheet:
    """Cells as text.

    Attributes:
        name: Of the sheet of a workbook; empty for a text.
        cells: Rows of cells; numbers have a decimal point.
        lines: The line of the file, from 1, of each row.
    """

    name: str
    cells: list[list[str]]
    lines: list[int]


@dataclass(frozen=True)
class Block:
    """Rows of numbers below their header.

    Attributes:
        sheet: Name of the sheet.
        header: Rows of text above the numbers, the nearest last.
        rows: Rows of cells, as wide as the widest.
        lines: The line of the file of each row.
    """

    sheet: str
    header: list[list[str]]
    rows: list[list[str]]
    lines: list[int]

    @property
    def width(self) -> int:
        """Number of columns."""
        return max(map(len, self.rows))


def number(cell: str) -> float | None:
    """The number in a cell, NaN for a word for a missing one, None for other text."""
    text = cell.strip().replace("\N{MINUS SIGN}", "-")
    if text.lower() in MISSING:
        return math.nan
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, which is not missing."""
    value = number(cell)
    return value is not None and not math.isnan(value)


def is_data(row: list[str]) -> bool:
    """Whether a row is one of numbers: two or more, and not fewer than other texts."""
    filled = [cell for cell in row if cell.strip()]
    numbers = sum(map(is_number, filled))
    return numbers >= 2 and 2 * numbers >= len(filled)


def blocks(sheet: Sheet) -> list[Block]:
    """The blocks of a sheet in order; a text between numbers begins a new one."""
    out: list[Block] = []
    header: list[list[str]] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    for row, line in zip(sheet.cells, sheet.lines, strict=True):
        if is_data(row) or (rows and any(map(is_number, row))):
            rows.append(row)
            lines.append(line)
        elif any(cell.strip() for cell in row):
            if rows:
                out.append(Block(sheet.name, header, rows, lines))
                header, rows, lines = [], [], []
            header.append(row)
    return [*out, Block(sheet.name, header, rows, lines)] if rows else out
