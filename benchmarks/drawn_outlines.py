"""Outlines of moving bodies that were drawn by hand on frames of real clips: benchmarks/outlines, see its README."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import VideoError

SHAPES = ("cylinder", "sphere", "box")


@dataclass(frozen=True)
class DrawnOutline:
    """The visible outline of one body on one frame."""

    object: str
    polygon: np.ndarray  # (N, 2) float64, px, x right and y down, pixel centres at integers, clipped to the frame


@dataclass(frozen=True)
class LengthMarks:
    """Two points of the scene whose distance is known."""

    px: np.ndarray  # (2, 2) float64, px
    m: float

    @property
    def px_per_m(self) -> float:
        return float(np.hypot(*(self.px[1] - self.px[0]))) / self.m


@dataclass(frozen=True)
class DrawnClip:
    """All that was drawn of one clip."""

    clip: str  # name of the video file
    width: int  # px, of the upright picture
    height: int  # px
    fps: float  # frames a second of the real motion
    file_fps: float  # frames a second as the file says
    stretch_frames: tuple[int, int]  # first and last frame of the stretch looked at, from 0
    stretch_file_seconds: tuple[float, float]  # their time stamps in the file
    objects: tuple[tuple[str, str], ...]  # name and shape of each moving body
    frames: dict[int, tuple[DrawnOutline, ...]]  # by frame index, from 0, in the order of decoding
    lines: dict[str, np.ndarray]  # polylines of bodies at rest, (N, 2) float64, px, by name
    length_marks: LengthMarks | None
    notes: str


def read_outlines(folder: Path | str) -> list[DrawnClip]:
    """The clips of all JSON files in `folder`, ordered by file name. Raises VideoError, which names file and place."""
    folder = Path(folder)
    files = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if not files:
        raise VideoError(f"{folder} has no outlines: a folder with a JSON file for each clip is needed")
    return [_read(path) for path in files]


def outline_mask(polygons: Sequence[np.ndarray], width: int, height: int) -> np.ndarray:
    """Ids (height, width) uint8: i + 1 where the pixel's centre lies in polygons[i], 0 elsewhere; later ones win.

    polygons: (N, 2) px each, pixel centres at integers; they need be neither convex nor inside the picture.
    """
    if len(polygons) > 255:
        raise ValueError(f"{len(polygons)} polygons: a mask has room for 255")
    mask = np.zeros((height, width), np.uint8)
    for i, polygon in enumerate(polygons):
        points = np.asarray(polygon, np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
            raise ValueError(f"polygon {i} has shape {points.shape}, (N, 2) with at least three points is needed")
        low = np.clip(np.ceil(points.min(0)), 0, (width, height)).astype(int)
        high = np.clip(np.floor(points.max(0)) + 1, 0, (width, height)).astype(int)
        x, y = np.arange(low[0], high[0])[None, :], np.arange(low[1], high[1])[:, None]
        inside = np.zeros((len(y), x.shape[1]), bool)
        for (x0, y0), (x1, y1) in zip(points, np.roll(points, -1, axis=0), strict=True):
            if y0 != y1:
                inside ^= ((y0 <= y) != (y1 <= y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        mask[low[1] : high[1], low[0] : high[0]][inside] = i + 1
    return mask


def _read(path: Path) -> DrawnClip:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise VideoError(f"{path} cannot be read as JSON: {error}") from error
    clip = str(_value(data, "clip", path))
    width, height = int(_number(data, "width", path)), int(_number(data, "height", path))
    first, last = _range(data, "stretch_frames", path)
    objects = tuple(_body(o, f"{path}: objects[{i}]") for i, o in enumerate(_value(data, "objects", path, list)))
    names = [name for name, _ in objects]
    if not names or len(set(names)) < len(names):
        raise VideoError(f"{path}: objects must have one or more entries with different names, got {names}")
    frames = {}
    for key, drawn in _value(data, "frames", path, dict).items():
        place = f"{path}: frames[{key!r}]"
        if not key.isdecimal() or not first <= int(key) <= last:
            raise VideoError(f"{place} is no frame of the stretch, {first:.0f} to {last:.0f}")
        if not isinstance(drawn, list):
            raise VideoError(f"{place} must be a list of outlines")
        outlines = tuple(_outline(o, names, (width, height), f"{place}[{i}]") for i, o in enumerate(drawn))
        if len({o.object for o in outlines}) < len(outlines):
            raise VideoError(f"{place} has two outlines of one body")
        frames[int(key)] = outlines
    static = dict(_value(data, "static", path, dict))
    marks = static.pop("length_marks", None)
    return DrawnClip(
        clip,
        width,
        height,
        _number(data, "fps", path),
        _number(data, "file_fps", path),
        (int(first), int(last)),
        _range(data, "stretch_file_seconds", path),
        objects,
        frames,
        {name: _points(p, 2, f"{path}: static[{name!r}]") for name, p in static.items()},
        None if marks is None else _marks(marks, f"{path}: static['length_marks']"),
        str(_value(data, "notes", path)),
    )


def _value(data: Any, key: str, place: Path | str, kind: type = object) -> Any:
    if not isinstance(data, dict) or key not in data:
        raise VideoError(f"{place} has no entry {key!r}")
    if not isinstance(data[key], kind):
        raise VideoError(f"{place}: {key!r} must be a {kind.__name__}, got {data[key]!r}")
    return data[key]


def _number(data: Any, key: str, place: Path | str) -> float:
    value = _value(data, key, place)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
        raise VideoError(f"{place}: {key!r} must be a positive number, got {value!r}")
    return float(value)


def _range(data: Any, key: str, place: Path) -> tuple[float, float]:
    value = _value(data, key, place, list)
    if len(value) != 2 or not all(isinstance(v, int | float) for v in value) or not 0 <= value[0] <= value[1]:
        raise VideoError(f"{place}: {key!r} must be two numbers [first, last], got {value!r}")
    return float(value[0]), float(value[1])


def _body(data: Any, place: str) -> tuple[str, str]:
    name, shape = str(_value(data, "name", place)), _value(data, "shape", place)
    if shape not in SHAPES:
        raise VideoError(f"{place}: shape is {shape!r}, one of {', '.join(SHAPES)} is needed")
    return name, shape


def _outline(data: Any, names: list[str], size: tuple[int, int], place: str) -> DrawnOutline:
    name = _value(data, "object", place)
    if name not in names:
        raise VideoError(f"{place}: there is no object {name!r}, only {', '.join(names)}")
    polygon = _points(_value(data, "polygon", place), 3, f"{place}: polygon")
    if (polygon < -0.5).any() or (polygon > np.array(size) - 0.5).any():
        raise VideoError(f"{place}: the polygon leaves the picture of {size[0]} x {size[1]} px")
    return DrawnOutline(name, polygon)


def _points(data: Any, least: int, place: str) -> np.ndarray:
    try:
        points = np.array(data, np.float64)
    except (TypeError, ValueError) as error:
        raise VideoError(f"{place} is no list of points [x, y]") from error
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < least or not np.isfinite(points).all():
        raise VideoError(f"{place} must be a list of at least {least} points [x, y], got shape {points.shape}")
    return points


def _marks(data: Any, place: str) -> LengthMarks:
    points = _points(_value(data, "px", place), 2, f"{place}: px")
    if len(points) != 2:
        raise VideoError(f"{place}: px has {len(points)} points, two are needed")
    return LengthMarks(points, _number(data, "m", place))
