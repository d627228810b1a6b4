"""The pieces of motion in a block of a sheet: which columns belong together, and which rows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.discovery.tables.header import SPATIAL, SPIN, TURN, Column, columns_of
from pipeline.discovery.tables.piece import COORDINATES, Piece
from pipeline.discovery.tables.said import Said, said_columns
from pipeline.discovery.tables.sheet import Block, number
from pipeline.discovery.tables.units import PIXELS
from pipeline.errors import MeasurementError

NEEDED = (
    "needed: time and one to three of x, y, z, as clip, object, time, x, y, z (s, m, z up), or --columns time=…,x=…,z=…"
)
RATE_WORDS = re.compile(r"frequency|(capture )?frame ?rate|fps", re.IGNORECASE)


def block_pieces(block: Block, path: Path, said: Said, notes: list[str], many: bool) -> list[Piece]:
    """The pieces of a block.

    Args:
        block: Rows below a header.
        path: For errors.
        said: What the user says of the table.
        notes: What was assumed is added.
        many: Whether the file has several sheets, whose names then tell bodies or recordings apart.

    Returns:
        A piece for each body and recording.

    Raises:
        MeasurementError: Where columns of times or positions are missing, or a cell is no number.
    """
    columns = columns_of(block.header, block.width)
    if said.assignments:
        columns = said_columns(said, columns, str(path))
    elif not any(c.role for c in columns):
        columns = _without_header(block, path, notes)
    timing = [c for role in ("time", "frame") for c in columns if c.role == role]
    spatial = [c for c in columns if c.role in SPATIAL]
    if not timing or not spatial:
        titles = ", ".join(repr(c.title) for c in columns if c.title) or "no titles"
        what = "times" if not timing else "positions"
        raise MeasurementError(f"{path}: no column of {what} among {titles}; {NEEDED}")
    unused = [c.title for c in columns if not c.role and c.title]
    if unused:
        notes.append(f"columns not used: {', '.join(dict.fromkeys(unused))}")
    rate = said.rate or _rate(block.header)
    values = {c.index: _values(block, c, path) for c in columns if c.role and c.role not in ("clip", "object")}
    texts = {role: _texts(block, columns, role) for role in ("clip", "object")}
    out = []
    for label in dict.fromkeys(c.label for c in spatial):
        clock = next((c for c in timing if c.label == label), None) or (timing[0] if timing[0].label == "" else None)
        clock = clock or (timing[0] if len(timing) == 1 else None)
        if clock is None:
            raise MeasurementError(f"{path}: no column of times of {label!r}; {NEEDED}")
        own = _chosen([c for c in columns if c.label == label and c.role in (*SPATIAL, *TURN, *SPIN, "sigma")])
        units = {c.unit for c in own if c.role in SPATIAL and c.unit}
        if len(units) > 1:
            raise MeasurementError(
                f"{path}: positions in different units ({', '.join(sorted(units))}); valid: one unit"
            )
        for clip, body, chosen in _groups(texts, len(block.rows)):
            measured = np.array([np.isfinite(values[c.index][chosen]) for c in own if c.role in SPATIAL]).any(0)
            kept = chosen[measured | np.isfinite(values[clock.index][chosen])]
            if len(kept) == 0:
                continue
            out.append(
                Piece(
                    label=label or (block.sheet if many else ""),
                    clip=f"{block.sheet} {clip}".strip() if many and clip else clip,
                    object=body,
                    time=values[clock.index][kept],
                    numbers={c.role: c.sign * values[c.index][kept] for c in own},
                    lines=np.array(block.lines)[kept],
                    time_unit="frame" if clock.role == "frame" else clock.unit,
                    unit=next(iter(units), ""),
                    rate=rate,
                )
            )
    return out


def _without_header(block: Block, path: Path, notes: list[str]) -> list[Column]:
    """Times and two or three coordinates, where the first column increases as a clock does."""
    values = np.array([[number(c) for c in [*row, ""][:1]] for row in block.rows], float)[:, 0]
    names = {2: ("time", "along"), 3: ("time", "x", "y"), 4: ("time", "x", "y", "z")}.get(block.width)
    if names is None or not (np.diff(values) > 0).all():
        first = ", ".join(block.rows[0][:6])
        raise MeasurementError(
            f"{path}: there is no header over {block.width} columns that begin with {first}; {NEEDED}, where a column "
            "may be its number: --columns time=1,x=2,z=3"
        )
    notes.append(
        f"there is no header: columns are taken for {', '.join('position' if n == 'along' else n for n in names)}"
    )
    return [Column(i, str(i + 1), name) for i, name in enumerate(names)]


def _chosen(columns: Sequence[Column]) -> list[Column]:
    """One column for each role: of several, the one that is not in pixels."""
    out: dict[str, Column] = {}
    for c in columns:
        if c.role not in out or (out[c.role].unit == PIXELS and c.unit != PIXELS):
            out[c.role] = c
    if len(out.keys() & set(COORDINATES)) and "along" in out:
        del out["along"]
    return list(out.values())


def _values(block: Block, column: Column, path: Path) -> np.ndarray:
    """(T,) numbers; NaN for what is missing."""
    out = np.full(len(block.rows), np.nan)
    for i, row in enumerate(block.rows):
        cell = row[column.index] if column.index < len(row) else ""
        value = number(cell)
        if value is None:
            raise MeasurementError(
                f"{path}: line {block.lines[i]}: {column.title or column.role} is {cell!r}, not a number"
            )
        out[i] = value
    return out


def _texts(block: Block, columns: Sequence[Column], role: str) -> list[str]:
    index = next((c.index for c in columns if c.role == role), None)
    if index is None:
        return [""] * len(block.rows)
    return [row[index].strip() if index < len(row) else "" for row in block.rows]


def _groups(texts: Mapping[str, list[str]], count: int) -> Iterable[tuple[str, str, np.ndarray]]:
    """Clip, object and indices of their rows, in the order of the first."""
    found: dict[tuple[str, str], list[int]] = {}
    for i in range(count):
        found.setdefault((texts["clip"][i], texts["object"][i]), []).append(i)
    return ((clip, body, np.array(index)) for (clip, body), index in found.items())


def _rate(header: Sequence[Sequence[str]]) -> float | None:
    """Frames per second, where the texts above a table say it."""
    for row in header:
        for word, value in pairwise(row):
            if RATE_WORDS.fullmatch(word.strip().strip(":")) and (number(value) or 0) > 0:
                return number(value)
    return None
