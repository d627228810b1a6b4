"""What the texts above columns of numbers say: times, coordinates, of which body or recording, in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.discovery.tables.units import unit_of

SPATIAL = ("x", "y", "z", "along")
TURN, SPIN = ("qw", "qx", "qy", "qz"), ("wx", "wy", "wz")
ROLES = ("time", "frame", "clip", "object", "x", "y", "z", *TURN, *SPIN, "sigma")
"""What a column may be said to have."""
_WORDS = {
    "time": "t|time|times|seconds|elapsed( time)?|time ?stamps?|video time|zeit|temps|tiempo|tempo|tid|čas|время",
    "frame": "frames?( ?#| number| no\\.?)?|field|bild|image",
    "clip": "(clip|trial|run|recording|take|drop|throw|toss|versuch|essai|ensayo)( ?#| number| no\\.?| ?id)?",
    "object": "object|body|marker|particle|track|mass|körper|objet",
    "along": "position|pos|distance|displacement|weg|ort",
    "z": "height|altitude|höhe|hauteur|altura|altezza",
    "sigma": "sigma",
}
_COORDINATE = re.compile(
    r"(?:(?:pos|position|coord|coordinate|center|centre|t)[\s_.-]*)?([xyz])(?:[\s_.-]*(?:pos|position|coord|coordinate))?"
)
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:[(\[](?P<in>[^()\[\]]*)[)\]]|(?:\s/\s*|_|\sin\s)(?P<after>[a-zA-Zµμ]+))$")
_RUN = re.compile(
    r"(?:latest|(?:run|trial|take|clip|throw|drop|toss|recording|data ?set|versuch|essai)[\s_#-]*\w{0,3})",
    re.IGNORECASE,
)
_KIND_WORDS = {
    "rigid body",
    "marker",
    "rigid body marker",
    "position",
    "rotation",
    "type",
    "name",
    "id",
    "parent",
    "trajectories",
    "#multi",
}
_RATES = {"velocity", "acceleration", "vel", "acc", "speed", "err", "error", "std", "momentum", "force"}
_RATE_SYMBOLS = {"v", "a", "d", "p", "f"}  # small ones: A_x and B_x are of bodies


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        index: From 0.
        title: As the file has it.
        role: Of `ROLES`, or `along` for a coordinate without a direction; empty for what is not used.
        label: Which body or recording, as the file calls it.
        unit: As `units.unit_of` names it; what the file says where that is no unit of these.
        sign: -1 where the numbers count the other way.
    """

    index: int
    title: str
    role: str = ""
    label: str = ""
    unit: str = ""
    sign: int = 1


def columns_of(header: Sequence[Sequence[str]], width: int) -> list[Column]:
    """The columns below a header, whose nearest row is the last; without roles where no row has a coordinate."""
    rows = [[cell.strip() for cell in row] + [""] * (width - len(row)) for row in header if len(row) <= width]
    if len(rows) == 0:
        return [Column(i, "") for i in range(width)]
    units = [row for row in rows if any(row) and all(unit_of(c) for c in row if c)]
    titled = [row for row in rows if row not in units]
    best = max(titled, key=lambda row: sum(bool(column(0, c).role) for c in row), default=[""] * width)
    above = [_filled(row) for row in titled[: titled.index(best)] if any(row)] if best in titled else []
    out = []
    for i in range(width):
        found = column(i, best[i])
        words = [row[i] for row in above if row[i]]
        names = [
            w for w in words if w.lower().rstrip(":") not in _KIND_WORDS and not re.fullmatch(r'"?[0-9A-Fa-f]{6,}"?', w)
        ]
        kinds = {w.lower() for w in words}
        if "rotation" in kinds and best[i].lower() in ("x", "y", "z", "w"):
            found = replace(found, role=f"q{best[i].lower()}")
        if any("error" in kind for kind in kinds):
            found = replace(found, role="")
        if names and not found.label and found.role not in ("time", "frame", "clip", "object"):
            found = replace(found, label="" if names[-1].lower() == "latest" else names[-1])
        said = next((unit_of(row[i]) for row in units if row[i]), None)
        out.append(found if said is None else replace(found, unit=said))
    return out


def column(index: int, title: str) -> Column:
    """The column that a title names: a unit at its end, and a body or recording before or after the coordinate."""
    name, unit = _without_unit(title)
    role = _role(name)
    if role:
        return Column(index, title, role, "", unit)
    for label, rest in _splits(name):
        role = _role(rest)
        if role and not _is_rate(label) and role not in ("clip", "object", "sigma"):
            return Column(index, title, role, "" if label.lower() == "latest" else label, unit)
    return Column(index, title)


def is_recording(label: str) -> bool:
    """Whether a label is that of a recording, and not of a body."""
    return _RUN.fullmatch(label) is not None


def _is_rate(label: str) -> bool:
    """Whether a word before a coordinate makes it something else than a position."""
    return label.lower() in _RATES or label in _RATE_SYMBOLS


def _without_unit(title: str) -> tuple[str, str]:
    found = _UNIT.match(title.strip())
    if found is None:
        return title.strip(), ""
    unit = found["in"] if found["in"] is not None else found["after"]
    known = unit_of(unit)
    if known is None and found["after"] is not None:
        return title.strip(), ""  # x_ball: no unit
    return found["name"], known or unit.strip()


def _role(name: str) -> str:
    """The role that a plain name has; empty for none."""
    plain = name.strip().lower()
    if plain in (*TURN, *SPIN):
        return plain
    for role, words in _WORDS.items():
        if re.fullmatch(words, plain):
            return role
    found = _COORDINATE.fullmatch(plain)
    return found[1] if found else ""


def _splits(name: str) -> list[tuple[str, str]]:
    """Label and rest: "Run 1: X", "ball_x", "ball X", "x_1", "X1", "x_ball"."""
    out = []
    for found in (
        re.fullmatch(r"(?P<label>.+?)\s*[:|]\s*(?P<rest>[^:|]+)", name),
        re.fullmatch(r"(?P<label>.+?)[\s_.\-]+(?P<rest>\w+)", name),
        re.fullmatch(r"(?P<rest>[a-zA-Z]+)[\s_.\-]+(?P<label>.+)", name),
        re.fullmatch(r"(?P<rest>[a-zA-Z]+?)(?P<label>\d+)", name),
    ):
        if found is not None:
            out.append((found["label"].strip(), found["rest"].strip()))
    return out


def _filled(row: Sequence[str]) -> list[str]:
    """The row with each name over the columns to its right that have none: names of bodies stand over their first."""
    out, last = [], ""
    for cell in row:
        last = cell or last
        out.append(last)
    return out
