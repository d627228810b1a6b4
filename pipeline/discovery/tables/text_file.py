"""Text files as sheets: encoding, comments, separator and decimal sign are what makes most of the lines numbers."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from pathlib import Path

from pipeline.discovery.tables.sheet import Sheet, is_data, number
from pipeline.errors import MeasurementError
from pipeline.untrusted import open_untrusted

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
COMMENT = re.compile(r"\s*(#|%|//)\s?")
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
TRIED_LINES = 500
MOST_HEADER_BYTES = 4096
COLUMNS = ("clip", "object", "time", "x", "y", "z")
"""Of the project's own format."""


def first_line(path: Path) -> str:
    """The first line of a text file, of which at most MOST_HEADER_BYTES are read."""
    with open_untrusted(path, MeasurementError) as file:
        return str(file.read(MOST_HEADER_BYTES).split(b"\n")[0].decode("utf-8", errors="replace"))


def text_sheet(data: bytes, place: str) -> tuple[Sheet, list[str]]:
    """The sheet of a text file, and what was assumed, a line each.

    Raises MeasurementError where it is no text, or no separator makes rows of numbers of it.
    """
    text, encoding = _decoded(data, place)
    numbered = [(line, at + 1) for at, line in enumerate(text.splitlines()) if line.strip()]
    comments = sum(COMMENT.match(line) is not None for line, _ in numbered)
    lines = [(COMMENT.sub("", line, count=1) if COMMENT.match(line) else line, at) for line, at in numbered]
    separator = max(SEPARATORS, key=lambda s: _rows_of_numbers([line for line, _ in lines[:TRIED_LINES]], s))
    cells = [_split(line, separator) for line, _ in lines]
    if not any(map(is_data, _with_points(cells))):
        begin, first = (lines[0][0], re.split(r"[\s,;]+", lines[0][0])) if lines else ("", [])
        lacks = [column for column in COLUMNS if column not in first]
        also = f" and no column {lacks[0]!r}" if 0 < len(lacks) < len(COLUMNS) else ""
        raise MeasurementError(
            f"{place}: no rows of numbers with tabs, semicolons, commas or spaces between them{also}; it begins with "
            f"{begin[:60]!r}; needed: a row for each time, with the columns {', '.join(COLUMNS)}"
        )
    comma = any(DECIMAL_COMMA.fullmatch(cell) for row in cells for cell in row)
    notes = [f"read as text with {SEPARATORS[separator]} between columns{' and decimal commas' if comma else ''}"]
    if encoding:
        notes.append(f"the encoding is taken for {encoding}")
    if comments:
        notes.append(f"{comments} lines of comments were read as part of the header or left out")
    return Sheet("", _with_points(cells) if comma else cells, [at for _, at in lines]), notes


def _decoded(data: bytes, place: str) -> tuple[str, str]:
    """The text, and the name of an encoding that was guessed."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace"), ""
    if b"\0" in data[:4096]:
        raise MeasurementError(f"{place}: it is no text; valid: text, .xlsx, .parquet, or a project of Tracker (.trk)")
    try:
        return data.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace"), "Windows-1252"


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


def _with_points(cells: list[list[str]]) -> list[list[str]]:
    return [[c.replace(",", ".") if DECIMAL_COMMA.fullmatch(c) else c for c in row] for row in cells]


def _rows_of_numbers(lines: list[str], separator: str) -> tuple[int, int]:
    """How many lines the separator makes rows of numbers of one width, and how many numbers these have."""
    others = [s for s in SEPARATORS if s not in (separator, " ", ",")] if separator in " ," else []
    rows = [_split(line, separator) for line in lines if not any(other in line for other in others)]
    kept = [row for row in _with_points(rows) if is_data(row)]
    widths = Counter(map(len, kept))
    width = max(widths, key=lambda w: widths[w], default=0)
    return widths[width], sum(number(cell) is not None for row in kept for cell in row if len(row) == width)
