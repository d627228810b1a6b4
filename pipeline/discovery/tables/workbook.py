"""Workbooks of Excel (.xlsx, Office Open XML) as sheets, by the standard library alone: values, not formulas."""

from __future__ import annotations

import io
import re
import zipfile
from xml.etree.ElementTree import Element

from pipeline.discovery.tables.sheet import Sheet
from pipeline.errors import MeasurementError
from pipeline.untrusted import MOST_TABLE_BYTES, parse_xml

MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
OLD_WORKBOOK = b"\xd0\xcf\x11\xe0"  # the compound files of Excel 97 to 2003
MOST_COLUMNS = 16384  # of a sheet of Excel


def workbook_sheets(data: bytes, place: str) -> list[Sheet]:
    """The sheets with any cells. Raises MeasurementError for a workbook that cannot be read."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(member.file_size for member in archive.infolist()) > MOST_TABLE_BYTES:
                raise MeasurementError(f"{place}: it unpacks to more than is read; save the sheet as CSV")
            texts = _shared_texts(archive)
            sheets = [_sheet(name, _root(archive, member), texts) for name, member in _members(archive)]
    except (zipfile.BadZipFile, KeyError, ValueError, IndexError, NotImplementedError) as error:
        raise MeasurementError(
            f"{place}: it is no workbook of Excel (.xlsx) that can be read ({error}); save the sheet as CSV"
        ) from None
    return [sheet for sheet in sheets if sheet.cells]


def _root(archive: zipfile.ZipFile, member: str) -> Element:
    return parse_xml(archive.read(member), member, ValueError)


def _members(archive: zipfile.ZipFile) -> list[tuple[str, str]]:
    """Name and file of each sheet."""
    targets = {link.get("Id"): link.get("Target", "") for link in _root(archive, "xl/_rels/workbook.xml.rels")}
    sheets = _root(archive, "xl/workbook.xml").iter(f"{MAIN}sheet")
    found = [(s.get("name", ""), targets[s.get(RELATION)]) for s in sheets]
    return [(name, target.lstrip("/") if target.startswith("/") else f"xl/{target}") for name, target in found]


def _shared_texts(archive: zipfile.ZipFile) -> list[str]:
    if "xl/sharedStrings.xml" not in archive.namelist():
        return []
    items = _root(archive, "xl/sharedStrings.xml").iter(f"{MAIN}si")
    return ["".join(t.text or "" for t in item.iter(f"{MAIN}t")) for item in items]


def _sheet(name: str, root: Element, texts: list[str]) -> Sheet:
    rows: list[list[str]] = []
    lines: list[int] = []
    for row in root.iter(f"{MAIN}row"):
        cells: list[str] = []
        for cell in row.iter(f"{MAIN}c"):
            column = _column(cell.get("r", "")) if cell.get("r") else len(cells)
            cells += [""] * (column + 1 - len(cells))
            cells[column] = _value(cell, texts)
        if any(cells):
            rows.append(cells)
            lines.append(int(row.get("r", len(lines) + 1)))
    return Sheet(name, rows, lines)


def _column(reference: str) -> int:
    """0 for A1, 26 for AA1."""
    index = 0
    for letter in re.match(r"[A-Z]*", reference)[0]:  # type: ignore[index]
        index = 26 * index + ord(letter) - ord("A") + 1
    if not 0 < index <= MOST_COLUMNS:
        raise ValueError(f"no such cell: {reference}")
    return index - 1


def _value(cell: Element, texts: list[str]) -> str:
    value = cell.findtext(f"{MAIN}v") or ""
    if cell.get("t") == "s":
        return texts[int(value)]
    if cell.get("t") == "inlineStr":
        return "".join(t.text or "" for t in cell.iter(f"{MAIN}t"))
    return value
