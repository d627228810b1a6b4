"""What a user says of a table by hand: its columns, its unit, a known length."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from pipeline.discovery.tables.header import ROLES, Column
from pipeline.discovery.tables.units import LENGTH, PIXELS, VALID, unit_of
from pipeline.errors import ParamsError, did_you_mean


@dataclass(frozen=True)
class Said:
    """What is known of a table that it does not say itself.

    Attributes:
        columns: "time=t,x=X1,y=-Y1": what a column is, its title or its number from 1; a minus turns its sign around.
            "ball:x=X1" is of one body.
        unit: Of positions, of `units.VALID`.
        length: (x0, y0, x1, y1, M): two points in the table's unit and their distance, m; or (N, M): N units are M m.
        rate: Frames per second, where a column counts frames.
        plane: "upright" or "ground", in which one or two coordinates lie.
    """

    columns: str | None = None
    unit: str | None = None
    length: Sequence[float] | None = None
    rate: float | None = None
    plane: str | None = None
    assignments: tuple[tuple[str, str, str, int], ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "assignments", tuple(_assignments(self.columns)) if self.columns else ())
        if self.unit is not None and unit_of(self.unit) not in VALID:
            raise ParamsError(f"--unit: {self.unit!r} is no unit of length; valid: {', '.join(VALID)}")
        if self.length is not None and not self.metres_per_unit > 0:
            raise ParamsError("--length: the two points are the same; valid: X0,Y0,X1,Y1=M or N=M, metres above 0")
        if self.unit is not None and unit_of(self.unit) == PIXELS and self.length is None:
            raise ParamsError("--unit px: needs --length X0,Y0,X1,Y1=M (two points, px, and their distance, m) or N=M")

    @property
    def metres_per_unit(self) -> float:
        """By the known length. There is one."""
        assert self.length is not None
        *ends, metres = self.length
        long = ends[0] if len(ends) == 1 else math.hypot(ends[2] - ends[0], ends[3] - ends[1])
        return metres / long if long > 0 else math.nan

    def scale(self, unit: str) -> float | None:
        """Metres per unit that the table has, or that was said instead; None where that is not known."""
        if self.length is not None:
            return self.metres_per_unit
        return LENGTH.get(unit_of(self.unit or unit) or unit)


def said_columns(said: Said, columns: Sequence[Column], place: str) -> list[Column]:
    """The columns as the user says they are. Raises ParamsError for a column that the table lacks."""
    out = []
    for label, role, name, sign in said.assignments:
        found = _find(name, columns)
        if found is None:
            titles = [c.title or str(c.index + 1) for c in columns]
            raise ParamsError(
                f"--columns: {place} has no column {name!r}{did_you_mean(name, titles)}; it has {', '.join(titles)} "
                f"(or 1 to {len(columns)})"
            )
        out.append(Column(found.index, found.title, role, label, found.unit, sign))
    return out


def _find(name: str, columns: Sequence[Column]) -> Column | None:
    """By title, with or without its unit and in any case, else by number."""
    plain = name.strip().lower()
    for wanted in (lambda c: c.title.lower(), lambda c: re.split(r"[(\[]", c.title.lower())[0].strip()):
        found = [c for c in columns if wanted(c) == plain]
        if found:
            return found[0]
    if plain.isdecimal() and 1 <= int(plain) <= len(columns):
        return columns[int(plain) - 1]
    return None


def _assignments(text: str) -> list[tuple[str, str, str, int]]:
    """Label, role, column and sign of each part of --columns."""
    out = []
    for part in text.split(","):
        left, equals, name = (p.strip() for p in part.partition("="))
        label, _, role = left.rpartition(":")
        sign = -1 if name.startswith("-") else 1
        name = name.removeprefix("-").strip()
        if role not in ROLES or not equals or not name:
            raise ParamsError(
                f"--columns: {part.strip()!r}{did_you_mean(role, ROLES)}; valid: WHAT=COLUMN with commas between, as "
                f"time=t,x=X1,y=-Y1; WHAT is one of {', '.join(ROLES)}, with NAME: before it for one of several bodies"
            )
        out.append((label.strip(), role, name, sign))
    roles = {role for _, role, _, _ in out}
    if not roles & {"time", "frame"} or not roles & {"x", "y", "z"}:
        raise ParamsError("--columns: valid: time (or frame) and at least one of x, y, z")
    return out
