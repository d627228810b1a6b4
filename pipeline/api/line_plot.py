"""Panels of lines and dots over one horizontal axis, as a picture.

Drawn with OpenCV and Pillow: importing matplotlib takes as long as all other pictures of `dynamics infer`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw

from pipeline.api.overlay import FAINT, INK, PAPER, font

WIDTH, PANEL, GAP = 770, 170, 16  # px, of the picture, the height of a panel, between panels
LEFT, RIGHT, TOP, BOTTOM = 90, 14, 44, 50  # px around the panels
EDGE = 0.05  # share of the range of values left free at each end of an axis
MOST_TICKS = 6
TEXT, DOT, TICK = 13, 2, 4  # px
_FINE = 4  # bits: OpenCV draws at sixteenths of a pixel


@dataclass(frozen=True)
class Series:
    """Values y (T,) at x (T,), as dots or as a line; where y is NaN there is nothing. colour: RGB."""

    x: np.ndarray
    y: np.ndarray
    colour: tuple[int, int, int]
    dots: bool


@dataclass(frozen=True)
class Panel:
    """Series in one frame. label: of the vertical axis. least: the least range that this axis has."""

    label: str
    series: tuple[Series, ...]
    least: float = 0.0


def draw_panels(
    panels: Sequence[Panel], title: str, legend: Sequence[tuple[str, tuple[int, int, int]]], label: str
) -> np.ndarray:
    """The picture (H, W, 3) uint8.

    Args:
        panels: From top to bottom.
        title: Over them.
        legend: Names and their colours, on the right of the title.
        label: Of the horizontal axis.
    """
    height = TOP + len(panels) * (PANEL + GAP) - GAP + BOTTOM
    page = np.full((height, WIDTH, 3), PAPER, np.uint8)
    across = extent([s.x for p in panels for s in p.series], 0.0)
    ranges = [extent([s.y for s in p.series], p.least) for p in panels]
    tops = [TOP + k * (PANEL + GAP) for k in range(len(panels))]
    for panel, (low, high), top in zip(panels, ranges, tops, strict=True):
        for series in panel.series:
            columns = LEFT + (series.x - across[0]) / (across[1] - across[0]) * (WIDTH - LEFT - RIGHT)
            _draw(page, columns, top + (high - series.y) / (high - low) * PANEL, series)
        cv2.line(page, (LEFT, top), (LEFT, top + PANEL), INK)
        cv2.line(page, (LEFT, top + PANEL), (WIDTH - RIGHT, top + PANEL), INK)
    picture = Image.fromarray(page)
    pen, small = ImageDraw.Draw(picture), font(TEXT)
    for panel, (low, high), top in zip(panels, ranges, tops, strict=True):
        for value, text in ticks(low, high):
            y = top + (high - value) / (high - low) * PANEL
            pen.line((LEFT - TICK, y, LEFT, y), fill=INK)
            pen.text((LEFT - TICK - 3, y), text, font=small, fill=INK, anchor="rm")
        upright = Image.new("RGB", (PANEL, TEXT + 5), PAPER)
        ImageDraw.Draw(upright).text((PANEL / 2, 0), panel.label, font=small, fill=INK, anchor="ma")
        picture.paste(upright.rotate(90, expand=True), (6, top))
    bottom = tops[-1] + PANEL
    for value, text in ticks(*across):
        x = LEFT + (value - across[0]) / (across[1] - across[0]) * (WIDTH - LEFT - RIGHT)
        pen.line((x, bottom, x, bottom + TICK), fill=INK)
        pen.text((x, bottom + TICK + 2), text, font=small, fill=INK, anchor="ma")
    pen.text(((LEFT + WIDTH - RIGHT) / 2, height - 6), label, font=small, fill=INK, anchor="md")
    pen.text((LEFT, 6), title, font=small, fill=FAINT)
    x = float(LEFT)
    for name, colour in legend:
        pen.line((x, 33, x + 18, 33), fill=colour, width=3)
        pen.text((x + 24, 33), name, font=small, fill=INK, anchor="lm")
        x += 44 + pen.textlength(name, font=small)
    return np.asarray(picture)


def extent(values: Sequence[np.ndarray], least: float) -> tuple[float, float]:
    """The range of an axis that shows all finite values, at least `least` long."""
    known = np.concatenate([np.ravel(v) for v in values]) if values else np.zeros(0)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    smallest = 1e-9 * max(abs(low), abs(high), 1e-3)  # rounding errors are no range
    half = max((0.5 + EDGE) * (high - low), 0.5 * least)
    if half <= smallest:
        half = 0.5 * max(abs(low), 1.0)
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Round values in a range, at most MOST_TICKS, and how they are written."""
    rough = (high - low) / MOST_TICKS
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(s * unit for s in (1, 2, 5, 10) if s * unit >= rough * (1 - 1e-9))
    digits = max(-math.floor(math.log10(step) + 1e-9), 0)
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(n * step, f"{n * step + 0.0:.{digits}f}") for n in numbers]


def _draw(page: np.ndarray, x: np.ndarray, y: np.ndarray, series: Series) -> None:
    shown = np.isfinite(x) & np.isfinite(y)
    points = np.rint(np.stack([x, y], 1)[shown] * 2**_FINE).astype(np.int32)
    if series.dots:
        for point in points.tolist():
            cv2.circle(page, point, DOT << _FINE, series.colour, -1, cv2.LINE_AA, _FINE)
        return
    whole = np.split(points, np.flatnonzero(np.diff(np.flatnonzero(shown)) > 1) + 1)
    cv2.polylines(page, whole, False, series.colour, 1, cv2.LINE_AA, _FINE)
