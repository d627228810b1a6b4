"""Projects of the video analysis program Tracker (.trk, XML): the point masses that were marked, in world coordinates.

Marks are pixels of the picture, y down. The coordinate system has its origin in pixels, an angle in degrees that its x
axis is turned up, and pixels per unit of length; frames last `delta_t` ms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from pipeline.discovery.tables.piece import Piece
from pipeline.discovery.tables.units import unit_of
from pipeline.errors import MeasurementError
from pipeline.untrusted import parse_xml

BEGIN = b'<object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel"'


def is_tracker_project(data: bytes) -> bool:
    """Whether a file is a project of Tracker."""
    return BEGIN in data[:4096]


def tracker_pieces(data: bytes, place: str) -> tuple[list[Piece], list[str]]:
    """The point masses of a project, and what was assumed. Raises MeasurementError where there are none."""
    root = parse_xml(data, f"{place}: it looks like a project of Tracker, but is damaged", MeasurementError)
    system = next((o for o in _objects(root, "ImageCoordSystem$FrameData")), None)
    if system is None:
        raise MeasurementError(f"{place}: the project has no coordinate system; set axes and scale in Tracker")
    frame_ms = _number(root, "delta_t", math.nan, deep=True)
    if not frame_ms > 0:
        raise MeasurementError(f"{place}: the project does not say how long a frame lasts (delta_t)")
    first, begin = _number(root, "startframe", 0.0, deep=True), _number(root, "starttime", 0.0, deep=True)
    unit, scaled = _text(root, "length_unit") or "m", _number(system, "xscale", 1.0) != 1.0
    pieces = []
    for mass in _objects(root, "tracker.PointMass"):
        marks = np.array(list(_marks(mass))).reshape(-1, 3)
        if len(marks):
            x, y = _in_world(marks[:, 1:], system)
            pieces.append(
                Piece(
                    label=_text(mass, "name") or "",
                    clip="",
                    object="",
                    time=(begin + (marks[:, 0] - first) * frame_ms) / 1e3,
                    numbers={"x": x, "y": y},
                    lines=marks[:, 0].astype(int),
                    time_unit="s",
                    unit=(unit_of(unit) or unit) if scaled else "px",
                )
            )
    if not pieces:
        raise MeasurementError(f"{place}: the project has no point mass with marks; track one in Tracker")
    return pieces, [f"read as a project of Tracker, {1e3 / frame_ms:.4g} frames a second, in its own axes"]


def _objects(root: Element, kind: str) -> Iterator[Element]:
    return (o for o in root.iter("object") if o.get("class", "").endswith(f".{kind}"))


def _marks(mass: Element) -> Iterator[tuple[float, float, float]]:
    """Frame and place, px, of each mark."""
    for entry in mass.findall("./property[@name='framedata']/property"):
        index, mark = entry.get("name", "").strip("[]"), entry.find("object")
        if index.isdecimal() and mark is not None:
            yield float(index), _number(mark, "x", math.nan), _number(mark, "y", math.nan)


def _in_world(place: np.ndarray, system: Element) -> tuple[np.ndarray, np.ndarray]:
    """World coordinates (T,) of pixels (T, 2)."""
    angle = math.radians(_number(system, "angle", 0.0))
    right, up = place[:, 0] - _number(system, "xorigin", 0.0), _number(system, "yorigin", 0.0) - place[:, 1]
    x = (right * math.cos(angle) + up * math.sin(angle)) / _number(system, "xscale", 1.0)
    return x, (up * math.cos(angle) - right * math.sin(angle)) / _number(system, "yscale", 1.0)


def _text(node: Element, name: str, deep: bool = False) -> str | None:
    return node.findtext(f"{'.//' if deep else './'}property[@name='{name}']")


def _number(node: Element, name: str, default: float, deep: bool = False) -> float:
    text = _text(node, name, deep)
    try:
        return default if text is None else float(text)
    except ValueError:
        return math.nan
