"""Measured motion: one track for each clip and object (docs/formats.md, "Measured motion"), from files and rows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.discovery.tracks.camera_error import CameraError
from pipeline.errors import MeasurementError
from pipeline.untrusted import read_table_bytes

NEEDED = ("clip", "object", "time", "x", "y", "z")
POSITION, QUATERNION, SPIN = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("wx", "wy", "wz")
OPTIONAL = (*QUATERNION, *SPIN, "sigma")
ROW_NUMBERS = ("time", *POSITION, *QUATERNION, *SPIN)
"""The numbers of a row of `track_rows`, in order."""
LEAST_ROWS = 5
REGULAR = 0.002  # largest relative scatter of the intervals of a regular recording


@dataclass(frozen=True)
class Track:
    """One object in one clip at T increasing times. A missing number is NaN; a missing column is None.

    Attributes:
        clip: Which recording.
        object: Name of the object in the scene.
        time: (T,) s.
        position: (T, 3) m.
        quaternion: (T, 4) w, x, y, z.
        angular_velocity: (T, 3) rad/s, in the world's frame.
        sigma: (T,) m, standard deviation of each coordinate of the position.
        camera_error: What is not known of the camera, which all tracks share; None where there is none.
        bounces: Times, s, of bounces off the ground that the recording shows; others are sought between them.
    """

    clip: str
    object: str
    time: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray | None = None
    angular_velocity: np.ndarray | None = None
    sigma: np.ndarray | None = None
    camera_error: CameraError | None = None
    bounces: tuple[float, ...] = ()

    def samples(self, which: np.ndarray) -> Track:
        """The track at some of its samples: indices, or (T,) bool."""
        turn, spin, sigma = (
            None if v is None else v[which] for v in (self.quaternion, self.angular_velocity, self.sigma)
        )
        moved = replace(self, time=self.time[which], position=self.position[which])
        return replace(moved, quaternion=turn, angular_velocity=spin, sigma=sigma)


def read_tracks(path: Path) -> list[Track]:
    """The tracks of a Parquet or CSV file, in its order.

    Raises `MeasurementError` that names the clip, the object and the row (the first row is 1).
    """
    table = read_table(path)
    missing = [c for c in NEEDED if c not in table]
    if missing:
        raise MeasurementError(
            f"{path}: no column {missing[0]!r}; needed: {', '.join(NEEDED)}; optional: {', '.join(OPTIONAL)}"
        )
    for group in (QUATERNION, SPIN):
        there = [c for c in group if c in table]
        if there and len(there) < len(group):
            raise MeasurementError(f"{path}: column {there[0]!r} without the others of {', '.join(group)}")
    return tracks_of(table, path)


def tracks_of(table: pd.DataFrame, path: Path) -> list[Track]:
    """The tracks of a table with the columns of the format, which is from a file. Raises as `read_tracks`."""
    if table.empty:
        raise MeasurementError(f"{path}: no rows")
    for column in ("clip", "object"):
        empty = table[column].isna().to_numpy()
        if empty.any():
            raise MeasurementError(f"{path}: row {int(empty.argmax()) + 1}: no {column}")
        table[column] = table[column].astype(str)
    for column in (*NEEDED[2:], *(c for c in OPTIONAL if c in table)):
        table[column] = number_column(table, column, path)
    grouped = table.groupby(["clip", "object"], sort=False)
    return [_track(path, str(c), str(o), rows) for (c, o), rows in grouped]


def read_table(path: Path) -> pd.DataFrame:
    """The table of a Parquet or CSV file as it is. Raises MeasurementError for one that cannot be read."""
    if path.suffix not in (".parquet", ".csv"):
        raise MeasurementError(f"{path}: unknown kind of file; valid: .parquet, .csv")
    data = read_table_bytes(path, MeasurementError)
    try:
        if path.suffix == ".parquet":
            return pq.read_table(data).to_pandas(ignore_metadata=True)  # columns that pandas took for an index, too
        table = pd.read_csv(data, dtype={"clip": str, "object": str}, keep_default_na=True)
    except (OSError, ValueError, LookupError, pa.ArrowException) as error:
        raise MeasurementError(f"{path} cannot be read ({(str(error) or 'damaged').splitlines()[0]})") from None
    if not isinstance(table.index, pd.RangeIndex):  # pandas takes the surplus fields of the first row for an index
        raise MeasurementError(f"{path}: row 1 has more fields than the header names ({len(table.columns)})")
    return table


def number_column(table: pd.DataFrame, column: str, path: Path) -> np.ndarray:
    """A column as numbers, NaN where it is empty. Raises MeasurementError that names the first row of another kind."""
    if table[column].dtype.kind in "mM" or _is_date(table[column]):
        raise MeasurementError(f"{path}: {column} is a date or a duration; valid: a number of seconds")
    values = pd.to_numeric(table[column], errors="coerce")
    bad = (values.isna() & table[column].notna()).to_numpy()
    if bad.any():
        row = int(bad.argmax())
        raise MeasurementError(f"{_place(path, table, row)}: {column} is {table[column].iloc[row]!r}, not a number")
    out = values.to_numpy(float)
    infinite = np.isinf(out)
    if infinite.any():
        raise MeasurementError(f"{_place(path, table, int(infinite.argmax()))}: {column} is infinite")
    return out


def _is_date(column: pd.Series) -> bool:
    """Whether the first value of a column of text is a date or a time of day."""
    first = next((str(value) for value in column if isinstance(value, str)), "")
    return re.fullmatch(r"\d{1,4}[-/]\d{1,2}[-/]\d{1,4}.*|\d{1,2}:\d{2}(:\d{2}.*)?", first) is not None


def _place(path: Path, table: pd.DataFrame, row: int) -> str:
    line = table.iloc[row]
    whose = f", object {line['object']}" if "object" in table else ""
    return f"{path}: clip {line['clip']}{whose}, row {table.index[row] + 1}"


def _track(path: Path, clip: str, name: str, rows: pd.DataFrame) -> Track:
    time, position = rows["time"].to_numpy(float), rows[list(POSITION)].to_numpy(float)
    sigma = rows["sigma"].to_numpy(float) if "sigma" in rows else None
    checks = [
        (np.isnan(time), "no time"),
        (np.diff(time, prepend=-np.inf) == 0, "the same time as the row before (a duplicate)"),
        (np.diff(time, prepend=-np.inf) < 0, "time goes back"),
        (np.zeros(len(time), bool) if sigma is None else sigma <= 0, "sigma must be greater than 0"),
    ]
    for bad, what in checks:
        if bad.any():
            raise MeasurementError(f"{_place(path, rows, int(bad.argmax()))}: {what}")
    measured = int(np.isfinite(position).all(1).sum())
    if measured < LEAST_ROWS:
        place = _place(path, rows, len(rows) - 1)
        raise MeasurementError(f"{place}: {measured} measured positions end this track; needed: {LEAST_ROWS} or more")
    quaternion = _unit(path, rows) if "qw" in rows else None
    spin = rows[list(SPIN)].to_numpy(float) if "wx" in rows else None
    return Track(clip, name, time, position, quaternion=quaternion, angular_velocity=spin, sigma=sigma)


def _unit(path: Path, rows: pd.DataFrame) -> np.ndarray:
    q = rows[list(QUATERNION)].to_numpy(float)
    size = np.linalg.norm(q, axis=1)
    if (size == 0).any():
        raise MeasurementError(f"{_place(path, rows, int((size == 0).argmax()))}: a quaternion of length zero")
    return q / size[:, None]


def tracks_table(tracks: Sequence[Track]) -> pa.Table:
    """The tracks as a table in the measured format, without the columns that no track has."""
    frames = []
    for t in tracks:
        frame = {"clip": [t.clip] * len(t.time), "object": [t.object] * len(t.time), "time": t.time}
        frame |= dict(zip(POSITION, t.position.T, strict=True))
        if t.quaternion is not None:
            frame |= dict(zip(QUATERNION, t.quaternion.T, strict=True))
        if t.angular_velocity is not None:
            frame |= dict(zip(SPIN, t.angular_velocity.T, strict=True))
        if t.sigma is not None:
            frame["sigma"] = t.sigma
        frames.append(pd.DataFrame(frame))
    return pa.Table.from_pandas(pd.concat(frames, ignore_index=True), preserve_index=False)


def track_rows(tracks: Iterable[Track]) -> list[dict[str, Any]]:
    """One row for each sample: clip, object, and `ROW_NUMBERS`, which are None where the track has no such column."""
    rows = []
    for t in tracks:
        missing = [None] * len(t.time)
        turn = [(q,) * 4 for q in missing] if t.quaternion is None else t.quaternion
        spin = [(w,) * 3 for w in missing] if t.angular_velocity is None else t.angular_velocity
        for parts in zip(t.time[:, None], t.position, turn, spin, strict=True):
            numbers = [None if v is None else float(v) for part in parts for v in part]
            rows.append({"clip": t.clip, "object": t.object} | dict(zip(ROW_NUMBERS, numbers, strict=True)))
    return rows


def tracks_from_rows(rows: Iterable[Mapping[str, Any]]) -> list[Track]:
    """The tracks of rows as `track_rows` makes them, in the order of their first rows."""
    grouped: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        grouped.setdefault((row["clip"], row["object"]), []).append(row)
    out = []
    for (clip, name), group in grouped.items():
        time, position = np.array([row["time"] for row in group]), _columns(group, POSITION)
        assert position is not None
        quaternion, spin = _columns(group, QUATERNION), _columns(group, SPIN)
        out.append(Track(clip, name, time, position, quaternion=quaternion, angular_velocity=spin))
    return out


def _columns(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray | None:
    """The named numbers of the rows, (T, len(names)); None where the first row lacks one."""
    if any(rows[0][name] is None for name in names):
        return None
    return np.array([[row[name] for name in names] for row in rows], float)


def frame_rate(tracks: Sequence[Track]) -> float | None:
    """Samples per second; None where the intervals, missing rows aside, are not all the same."""
    steps = np.concatenate([np.diff(t.time) for t in tracks])
    step = float(np.median(steps))
    whole = steps / step
    near = np.abs(whole - np.rint(whole)) < 0.05
    if step <= 0 or near.mean() < 0.98:
        return None
    step = float(np.median(steps[near] / np.rint(whole[near]).clip(1)))
    scatter = float(np.median(np.abs(steps[near] / np.rint(whole[near]).clip(1) - step))) / step
    return 1 / step if scatter < REGULAR else None
