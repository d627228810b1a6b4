"""Small tables: aligned for the terminal, cells for a picture."""

from __future__ import annotations

from collections.abc import Sequence

Row = tuple[str, ...]


def aligned(rows: Sequence[Row]) -> list[str]:
    """Rows as lines with columns of equal width: the first two to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [c.ljust(w) if i < 2 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return lines


def markdown(rows: Sequence[Row]) -> list[str]:
    """Rows, the first of them headings, as lines of a Markdown table."""
    rule = tuple("---" for _ in rows[0])
    return [f"| {' | '.join(row)} |" for row in (rows[0], rule, *rows[1:])]
