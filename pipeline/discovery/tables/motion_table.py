"""A file of measured motion as rows of the project's own format (docs/formats.md), and what was assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.discovery.tables.block_pieces import NEEDED, block_pieces
from pipeline.discovery.tables.naming import named, recordings
from pipeline.discovery.tables.piece import Piece
from pipeline.discovery.tables.placing import in_units, placed
from pipeline.discovery.tables.said import Said
from pipeline.discovery.tables.sheet import blocks
from pipeline.discovery.tables.text_file import text_sheet
from pipeline.discovery.tables.tracker_project import is_tracker_project, tracker_pieces
from pipeline.discovery.tables.workbook import OLD_WORKBOOK, workbook_sheets
from pipeline.errors import MeasurementError
from pipeline.untrusted import read_table_bytes


@dataclass(frozen=True)
class MotionTable:
    """What a file has.

    Attributes:
        rows: Columns clip, object, time (s), x, y, z (m, z up) and what else was measured; the index is the line of the
            file, from 0.
        notes: What was assumed.
        own_heights: Whether heights are from an origin of the table's own, which need not be the ground.
    """

    rows: pd.DataFrame
    notes: tuple[str, ...]
    own_heights: bool


def read_motion_table(path: Path, bodies: Mapping[str, float], said: Said) -> MotionTable:
    """Read a table of measured motion.

    Args:
        path: A text, a workbook (.xlsx) or a project of Tracker (.trk).
        bodies: Name -> height of the centre above z = 0 where the body rests on the ground, m, of the scene's objects.
        said: What the user says of the table.

    Returns:
        The rows.

    Raises:
        MeasurementError: That says what the file looks like and what it needs.
        ParamsError: For what the user says that the table does not have.
    """
    pieces, notes = _pieces_of(path, said)
    own_columns = all(p.clip and p.object for p in pieces)  # of the project's format, in which z is up
    pieces, names = named(pieces, list(bodies), path)
    pieces, units = in_units(pieces, said, path)
    pieces, clips = recordings(pieces, path.stem)
    pieces, places, own_heights = placed(pieces, bodies, said, path, own_columns)
    return MotionTable(_rows(pieces), (*notes, *names, *units, *clips, *places), own_heights)


def _pieces_of(path: Path, said: Said) -> tuple[list[Piece], list[str]]:
    data = read_table_bytes(path, MeasurementError).getvalue()
    if is_tracker_project(data):
        return tracker_pieces(data, str(path))
    if data.startswith(OLD_WORKBOOK):
        raise MeasurementError(f"{path}: it is a workbook of Excel 97 to 2003; save it as .xlsx or CSV")
    if data.startswith(b"PK"):
        sheets, notes = (
            workbook_sheets(data, str(path)),
            ["read as a workbook of Excel, numbers as they stand in its cells"],
        )
    else:
        sheet, notes = text_sheet(data, str(path))
        sheets = [sheet]
    pieces = []
    for sheet in sheets:
        for block in blocks(sheet):
            pieces += block_pieces(block, path, said, notes, len(sheets) > 1)
    if not pieces:
        raise MeasurementError(f"{path}: no sheet has rows of numbers; {NEEDED}")
    return pieces, list(dict.fromkeys(notes))


def _rows(pieces: Sequence[Piece]) -> pd.DataFrame:
    frames = [
        pd.DataFrame({"clip": p.clip, "object": p.object, "time": p.time, **p.numbers}, index=p.lines - 1)
        for p in pieces
    ]
    return pd.concat(frames)
