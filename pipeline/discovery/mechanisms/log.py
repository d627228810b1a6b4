"""The log of a mechanism (docs/formats.md, "Logs of mechanisms"): a recording for each clip, checked by the model."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.discovery.tables.sheet import MISSING, blocks
from pipeline.discovery.tables.text_file import first_line, text_sheet
from pipeline.discovery.tracks.track import number_column, read_table
from pipeline.errors import MeasurementError, did_you_mean
from pipeline.untrusted import read_table_bytes

LEAST_ROWS = 5
ONE_CLIP = "clip"  # name of the only clip of a table without that column
VELOCITY = "_velocity"
AXES = ("_x", "_y", "_z")


class Quantity(StrEnum):
    """What a column measures."""

    JOINT = "joint"
    VELOCITY = "velocity"
    SENSOR = "sensor"
    SITE = "site"
    BODY = "body"


@dataclass(frozen=True)
class Channel:
    """A measured column.

    Attributes:
        column: Its name in the table.
        quantity: What it measures.
        name: Of the joint, sensor, site or body.
        component: Of a site's or a body's position.
        unit: In plain text.
    """

    column: str
    quantity: Quantity
    name: str
    component: int
    unit: str


@dataclass(frozen=True)
class Clip:
    """One recording.

    Attributes:
        name: Which.
        time: (T,) s, increasing.
        values: (T, C), NaN where there is no measurement.
        controls: (T, nu), each held until the next row; 0 of actuators that the table lacks.
        sigma: (T,) standard deviation of each measured number; None where not given.
    """

    name: str
    time: np.ndarray
    values: np.ndarray
    controls: np.ndarray
    sigma: np.ndarray | None


@dataclass(frozen=True)
class Log:
    """All recordings of a mechanism. driven: names of the actuators whose controls the table has; notes: what was
    assumed of the file, a sentence each."""

    channels: tuple[Channel, ...]
    clips: tuple[Clip, ...]
    driven: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def column(self, quantity: Quantity, name: str) -> int | None:
        """Index of the channel of a quantity; None where it was not measured."""
        return next((i for i, c in enumerate(self.channels) if (c.quantity, c.name) == (quantity, name)), None)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the measured joints."""
        return tuple(c.name for c in self.channels if c.quantity is Quantity.JOINT)


def read_log(path: Path, mechanism: Mechanism) -> Log:
    """The log of a Parquet or CSV file, or of a text with other separators.

    Raises MeasurementError that names the column, the clip or the row (the first row is 1).
    """
    table, notes = _table(path)
    if "time" not in table:
        raise MeasurementError(f"{path}: no column 'time'; needed: time (s) and measured joints of {mechanism.path}")
    if table.empty:
        raise MeasurementError(f"{path}: no rows")
    if "clip" not in table:
        table["clip"] = ONE_CLIP
    empty = table["clip"].isna().to_numpy()
    if empty.any():
        raise MeasurementError(f"{path}: row {int(empty.argmax()) + 1}: no clip")
    table["clip"] = table["clip"].astype(str)
    channels = _channels(path, [str(c) for c in table.columns], mechanism)
    driven = tuple(a for a in mechanism.actuators if a in table)
    for column in ("time", *(c.column for c in channels), *driven, *(["sigma"] if "sigma" in table else [])):
        table[column] = number_column(table, column, path)
    if not any(np.isfinite(table[c.column]).any() for c in channels):
        raise MeasurementError(f"{path}: every measured number is missing")
    clips = [
        _clip(path, str(name), rows, channels, driven, mechanism) for name, rows in table.groupby("clip", sort=False)
    ]
    used = [i for i, c in enumerate(channels) if any(np.isfinite(clip.values[:, i]).any() for clip in clips)]
    moving = np.concatenate([c.values[:, used] for c in clips])
    if np.nanmax(np.nanmax(moving, 0) - np.nanmin(moving, 0)) == 0:
        raise MeasurementError(f"{path}: nothing moves: every measured number is the same in all rows")
    return Log(channels, tuple(clips), driven, notes)


def _table(path: Path) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The table of a file as it is, and what was assumed of it."""
    if path.suffix == ".parquet" or (path.suffix == ".csv" and not re.search("[;\t]", first_line(path))):
        return read_table(path), ()
    sheet, notes = text_sheet(read_table_bytes(path, MeasurementError).getvalue(), str(path))
    found = max(blocks(sheet), key=lambda block: len(block.rows))
    names = found.header[-1] if found.header else []
    if len(names) != found.width:
        raise MeasurementError(
            f"{path}: the line above the numbers has {len(names)} names for {found.width} columns; needed: a name for "
            "each, among them time (s)"
        )
    cells = [[None if cell.lower() in MISSING else cell for cell in row] for row in found.rows]
    return pd.DataFrame(cells, columns=names), tuple(notes)


def _channels(path: Path, columns: Sequence[str], mechanism: Mechanism) -> tuple[Channel, ...]:
    """What each column measures. Raises MeasurementError for a column that names nothing in the model."""
    model = mechanism.model
    joints = {j.name: j for j in mechanism.joints}
    sensors = {model.sensor(k).name: k for k in range(model.nsensor)}
    places = {Quantity.SITE: [model.site(k).name for k in range(model.nsite)], Quantity.BODY: mechanism.bodies}
    valid = ["clip", "time", "sigma", *joints, *(f"{j}{VELOCITY}" for j in joints), *mechanism.actuators, *sensors]
    out: list[Channel] = []
    for column in columns:
        if column in ("clip", "time", "sigma") or (column in mechanism.actuators and column not in joints):
            continue
        found = None
        stem = column.removesuffix(VELOCITY)
        if column in joints:
            found = Channel(column, Quantity.JOINT, column, 0, joints[column].unit)
        elif stem != column and stem in joints:
            found = Channel(column, Quantity.VELOCITY, stem, 0, f"{joints[stem].unit}/s")
        elif column in sensors:
            if model.sensor_dim[sensors[column]] != 1:
                raise MeasurementError(
                    f"{path}: {column}: the sensor has several numbers; valid: sensors of one number"
                )
            found = Channel(column, Quantity.SENSOR, column, 0, "-")
        else:
            for quantity, names in places.items():
                if column[-2:] in AXES and column[:-2] in names and found is None:
                    found = Channel(column, quantity, column[:-2], AXES.index(column[-2:]), "m")
        if found is None:
            near = did_you_mean(column, valid)
            raise MeasurementError(
                f"{path}: column {column!r}{near} names nothing in {mechanism.path}; valid: {', '.join(valid)}, "
                "and _x, _y, _z of its sites and bodies"
            )
        out.append(found)
    if not out:
        raise MeasurementError(f"{path}: no measured column; valid: {', '.join(valid[3:])}")
    return tuple(out)


def _clip(
    path: Path,
    name: str,
    rows: pd.DataFrame,
    channels: Sequence[Channel],
    driven: Sequence[str],
    mechanism: Mechanism,
) -> Clip:
    """The recording of a clip.

    Args:
        path: Of the table.
        name: Of the clip.
        rows: Of the table.
        channels: Its measured columns.
        driven: Its columns of controls.
        mechanism: The model.
    """
    time = rows["time"].to_numpy(float)
    place = f"{path}: clip {name!r}"
    if len(rows) < LEAST_ROWS:
        raise MeasurementError(f"{place}: {len(rows)} rows; at least {LEAST_ROWS} are needed")
    missing = ~np.isfinite(time)
    if missing.any():
        raise MeasurementError(f"{place}: row {int(rows.index[missing.argmax()]) + 1}: no time")
    back = np.diff(time) <= 0
    if back.any():
        row = int(rows.index[back.argmax() + 1]) + 1
        raise MeasurementError(f"{place}: row {row}: the time does not increase")
    controls = np.zeros((len(rows), len(mechanism.actuators)))
    for actuator in driven:
        held = rows[actuator].ffill().bfill().fillna(0.0)  # held until the next row that has one
        controls[:, mechanism.actuators.index(actuator)] = held
    sigma = rows["sigma"].to_numpy(float) if "sigma" in rows else None
    if sigma is not None and not (sigma[np.isfinite(sigma)] > 0).all():
        raise MeasurementError(f"{place}: sigma is not greater than 0")
    return Clip(name, time, np.column_stack([rows[c.column].to_numpy(float) for c in channels]), controls, sigma)
