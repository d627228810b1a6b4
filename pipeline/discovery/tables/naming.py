"""Which body of the scene, and which recording, each piece of a table is of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.discovery.tables.header import is_recording
from pipeline.discovery.tables.piece import Piece
from pipeline.errors import MeasurementError


def named(pieces: Sequence[Piece], names: Sequence[str], path: Path) -> tuple[list[Piece], list[str]]:
    """The pieces with their objects and recordings, of those objects that the scene has."""
    plain, notes = {_plain(name): name for name in names}, []
    labels = list(dict.fromkeys(p.label for p in pieces if not p.object))
    bodies = {label: plain[_plain(label)] for label in labels if _plain(label) in plain}
    runs = {label for label in labels if label and label not in bodies and is_recording(label)}
    rest = [label for label in labels if label and label not in bodies and label not in runs]
    if bodies and rest:
        notes.append(f"not used, since the scene has no such object: {', '.join(rest)}")
        pieces = [p for p in pieces if p.object or p.label not in rest]
    elif rest and len(names) == 1 and len(rest) == 1:
        bodies[rest[0]] = names[0]
        notes.append(f"{rest[0]!r} is the scene's object {names[0]}")
    elif rest and len(names) == 1:
        runs |= set(rest)
        notes.append(f"{', '.join(map(repr, rest))} are recordings of the scene's only object, {names[0]}")
    elif rest and len(rest) == len(names):
        bodies |= dict(zip(rest, names, strict=True))
        notes.append(f"{', '.join(map(repr, rest))} are the scene's {', '.join(names)}, by their order")
    elif rest:
        raise MeasurementError(
            f"{path}: it shows {', '.join(map(repr, rest))}, the scene has {', '.join(names)}; needed: the same names"
        )
    out = []
    for p in pieces:
        body = plain.get(_plain(p.object), p.object) or bodies.get(p.label, "")
        if not body:
            if len(names) > 1:
                raise MeasurementError(
                    f"{path}: it does not say which object of the scene moves; needed: a column `object` with one of "
                    f"{', '.join(names)}, or --columns NAME:x=…"
                )
            body = names[0]
            notes.append(f"the body is the scene's only object, {body}")
        clip = p.clip or (p.label if p.label in runs else "")
        out.append(replace(p, object=body, clip=clip))
    return out, list(dict.fromkeys(notes))


def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", "", name.lower())


def recordings(pieces: Sequence[Piece], stem: str) -> tuple[list[Piece], list[str]]:
    """The pieces with the name of their recording: a clock that begins anew begins a new one."""
    out, notes = [], []
    for p in pieces:
        back = np.flatnonzero(np.diff(p.time) < 0) + 1
        anew = [i for i in back if p.time[i] <= p.time[0] + 0.2 * (p.time[i - 1] - p.time[0])]
        if p.clip or len(anew) == 0 or len(anew) != len(back):
            out.append(p if p.clip else replace(p, clip=stem))
            continue
        notes.append(f"the clock begins anew {len(anew)} times: these are {len(anew) + 1} recordings")
        for k, rows in enumerate(np.split(np.arange(len(p.time)), anew)):
            numbers = {name: v[rows] for name, v in p.numbers.items()}
            out.append(replace(p, clip=f"{stem}_{k + 1}", time=p.time[rows], numbers=numbers, lines=p.lines[rows]))
    seen: dict[tuple[str, str], int] = {}
    for i, p in enumerate(out):  # blocks one below the other, or sheets, that have no name of their own
        count = seen[p.clip, p.object] = seen.get((p.clip, p.object), 0) + 1
        if count > 1:
            out[i] = replace(p, clip=f"{p.clip}_{count}")
    return out, list(dict.fromkeys(notes))
