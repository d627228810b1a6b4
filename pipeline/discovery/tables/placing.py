"""Pieces in the world: seconds, metres, and z up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.discovery.tables.header import SPATIAL, SPIN, TURN
from pipeline.discovery.tables.orientation import GRAVITY, Accelerations, accelerations
from pipeline.discovery.tables.piece import Piece
from pipeline.discovery.tables.said import Said
from pipeline.discovery.tables.units import PIXELS, TIME
from pipeline.errors import MeasurementError
from pipeline.scene.rotation import quaternion_multiply


def in_units(pieces: Sequence[Piece], said: Said, path: Path) -> tuple[list[Piece], list[str]]:
    """The pieces in seconds and metres."""
    out, notes = [], []
    for p in pieces:
        if p.time_unit == "frame":
            rate = said.rate or p.rate
            if rate is None:
                raise MeasurementError(f"{path}: it counts frames; needed: a column of times, or --fps")
            time = p.time / rate
            notes.append(f"frames are counted at {rate:g} a second")
        elif p.time_unit and p.time_unit not in TIME:
            raise MeasurementError(f"{path}: {p.time_unit!r} is no unit of time; valid: {', '.join(TIME)}")
        else:
            time = p.time * TIME[p.time_unit or "s"]
            if p.time_unit != "s":
                notes.append(
                    f"times are in {p.time_unit}" if p.time_unit else "times have no unit: they are taken for s"
                )
        scale = said.scale(p.unit or "m")
        if scale is None and p.unit == PIXELS:
            raise MeasurementError(
                f"{path}: positions are in pixels; needed: --length X0,Y0,X1,Y1=M, two points in px and their distance "
                "in m, or --length N=M"
            )
        if scale is None:
            raise MeasurementError(f"{path}: {p.unit!r} is no unit of length; say --unit")
        if said.length is not None:
            notes.append(f"one {p.unit or said.unit or 'unit'} is {scale:.6g} m, by --length")
        elif (said.unit or p.unit) != "m":
            unit = said.unit or p.unit
            notes.append(f"positions are in {unit}" if unit else "positions have no unit: they are taken for m")
        lengths = (*SPATIAL, "sigma")
        numbers = {k: v * scale if k in lengths else v for k, v in p.numbers.items()}
        out.append(replace(p, time=time, numbers=numbers, unit="m" if p.unit or said.unit or said.length else ""))
    return out, list(dict.fromkeys(notes))


def placed(
    pieces: Sequence[Piece], bodies: Mapping[str, float], said: Said, path: Path, z_is_up: bool
) -> tuple[list[Piece], list[str], bool]:
    """The pieces with x, y, z in the world, how they were placed, and whether heights are from an own origin."""
    axes = tuple(a for a in SPATIAL if any(a in p.numbers for p in pieces))
    if any(tuple(a for a in SPATIAL if a in p.numbers) != axes for p in pieces):
        raise MeasurementError(f"{path}: bodies with different coordinates; valid: the same for all")
    found = accelerations([(p.time, np.column_stack([p.numbers[a] for a in axes])) for p in pieces])
    stated = any(p.unit for p in pieces)
    if found is not None and not stated:
        _check_metres(found, axes, path)
    if len(axes) == 3:
        return _in_space(pieces, None if z_is_up else found)
    upright = axes[-1]
    down = 0 if found is None else found.falls(len(axes) - 1)
    if said.plane is not None:
        is_upright, why = said.plane == "upright", f"as --plane {said.plane} says"
    elif upright == "z":
        is_upright, why = True, "as its name says"
    else:
        is_upright, why = down != 0, "bodies fall along it" if down else "nothing falls"
    names = ["the position" if a == "along" else a for a in axes]
    if not is_upright:
        verb = "is" if len(names) == 1 else "are"
        notes = [f"{' and '.join(names)} {verb} along the ground, on which bodies lie ({why}; --plane says otherwise)"]
        out = [
            _with(
                p,
                p.numbers[axes[0]],
                p.numbers[axes[1]] if len(axes) > 1 else 0 * p.time,
                0 * p.time + bodies.get(p.object, 0.0),
            )
            for p in pieces
        ]
        return out, notes, False
    sign = -1.0 if down > 0 else 1.0
    turned = "down, and was turned around" if down > 0 else "up"
    notes = [f"{names[-1]} is {turned} ({why}; --plane says otherwise); the motion is in one upright plane"]
    out = [
        _with(p, p.numbers[axes[0]] if len(axes) > 1 else 0 * p.time, 0 * p.time, sign * p.numbers[upright])
        for p in pieces
    ]
    return out, notes, True


def _in_space(pieces: Sequence[Piece], found: Accelerations | None) -> tuple[list[Piece], list[str], bool]:
    """Three coordinates, z up or y up."""
    if found is None or found.falls(2) or not found.falls(1):
        return list(pieces), ["z is up"], False
    sign = -float(found.falls(1))
    quarter = np.array([np.sqrt(0.5), sign * np.sqrt(0.5), 0.0, 0.0])  # about x
    out = []
    for p in pieces:
        n = dict(p.numbers)
        placed = _with(p, n["x"], -sign * n["z"], sign * n["y"])
        if all(k in n for k in TURN):
            turned = quaternion_multiply(quarter, np.column_stack([n[k] for k in TURN]))
            placed.numbers.update(zip(TURN, turned.T, strict=True))
        if all(k in n for k in SPIN):
            placed.numbers.update({"wx": n["wx"], "wy": -sign * n["wz"], "wz": sign * n["wy"]})
        out.append(placed)
    return out, [f"y is {'up' if sign > 0 else 'down'} (bodies fall along it): axes were turned so that z is up"], True


def _check_metres(found: Accelerations, axes: Sequence[str], path: Path) -> None:
    """Raise MeasurementError where bodies fall far faster than things do, so that lengths cannot be metres."""
    size = float(np.abs(found.mean).max())
    if size < 5 * GRAVITY or found.is_braking:
        return
    likely = next((unit for unit, factor in (("cm", 100), ("mm", 1000)) if 0.7 < size / GRAVITY / factor < 1.3), PIXELS)
    raise MeasurementError(
        f"{path}: bodies fall at {size:.4g} per s², which is not m/s²: positions look like {likely}; needed: --unit "
        f"{likely}{' --length X0,Y0,X1,Y1=M (two points in px and their distance in m)' if likely == PIXELS else ''}"
    )


def _with(piece: Piece, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Piece:
    numbers = {k: v for k, v in piece.numbers.items() if k not in SPATIAL}
    return replace(piece, numbers={"x": x, "y": y, "z": z, **numbers})
