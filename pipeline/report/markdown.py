"""Tables in Markdown, at once or row by row."""

from __future__ import annotations

from collections.abc import Sequence


def table_row(cells: Sequence[str]) -> str:
    """One line."""
    return "| " + " | ".join(cells) + " |"


def heading(columns: Sequence[str]) -> str:
    """Two lines: the names of the columns, and the rule below them."""
    return table_row(columns) + "\n|" + " --- |" * len(columns)


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table, with a line break at its end."""
    return "\n".join([heading(header), *map(table_row, rows)]) + "\n"
