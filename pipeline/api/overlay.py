"""What people look at: overlay.png, captions on pictures, and small tables.

overlay.png shows the input with the outlines of the replay over it, the replay, and the flow of both, at five moments.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pipeline.vision.flow.flow_picture import flow_picture
from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.rendering.appearance import object_colour

Row = tuple[str, ...]

INK, FAINT, PAPER = (25, 28, 33), (120, 125, 135), (255, 255, 255)
MARGIN, CAPTION_PX, BETWEEN = 8, 15, 4  # px; the last: between two clips
TILE_AREA = 384 * 256  # px² of a picture
GAP, SIDE, HEADER, LINE = 6, 128, 30, 21  # px
MOMENTS = 5
_FINE = 16  # outlines are drawn at sixteenths of a pixel


@dataclass(frozen=True)
class Sheet:
    """What overlay.png shows.

    Attributes:
        frames: (P,) The frames of the clip that may be shown.
        times: (F,) s, of the frames in the video.
        rgb: (F, H, W, 3) uint8 of the input.
        replay_rgb: (F, H, W, 3) uint8 of the replay.
        masks: (F, H, W) of the input.
        replay_masks: (F, H, W).
        flow: (P, H, W, 2) px, of the input.
        replay_flow: (P, H, W, 2) px.
        names: Of the replay's objects.
        title: Of the picture.
        rows: A table under the title, its headings first.
    """

    frames: np.ndarray
    times: np.ndarray
    rgb: np.ndarray
    replay_rgb: np.ndarray
    masks: np.ndarray
    replay_masks: np.ndarray
    flow: np.ndarray
    replay_flow: np.ndarray
    names: tuple[str, ...]
    title: str
    rows: tuple[Row, ...]


def draw(sheet: Sheet) -> np.ndarray:
    """The picture, (H, W, 3) uint8."""
    chosen = np.unique(np.rint(np.linspace(0, len(sheet.frames) - 1, MOMENTS)).astype(int))
    shown = sheet.frames[chosen]
    times = [f"t = {sheet.times[f]:.2f} s" for f in shown]
    longest = max(float(np.quantile(np.linalg.norm(sheet.flow[chosen], axis=-1), 0.999)), 1.0)
    size = of_area((sheet.rgb.shape[2], sheet.rgb.shape[1]), TILE_AREA)
    rows = [
        ("input\nwith the replay's\noutlines", [outlined(sheet.rgb[f], sheet.replay_masks[f], size) for f in shown]),
        ("replay", [_tile(sheet.replay_rgb[f], size) for f in shown]),
        ("input's masks", [_tile(_painted(sheet.rgb[f], sheet.masks[f]), size) for f in shown]),
        (f"input's flow\n(full colour:\n{longest:.1f} px)", [_wheel(sheet.flow[p], longest, size) for p in chosen]),
        ("replay's flow", [_wheel(sheet.replay_flow[p], longest, size) for p in chosen]),
    ]
    top = HEADER + LINE * (len(sheet.rows) + 1) + GAP
    across = SIDE + len(chosen) * (size[0] + GAP) + GAP
    page = Image.new("RGB", (across, top + 24 + len(rows) * (size[1] + GAP)), PAPER)
    pen = ImageDraw.Draw(page)
    pen.text((GAP, GAP), sheet.title, font=font(20), fill=INK)
    _write_table(pen, sheet.rows, HEADER + 2)
    _legend(pen, sheet.names, HEADER + 2 + len(sheet.rows) * LINE)
    for column, time in enumerate(times):
        pen.text((SIDE + column * (size[0] + GAP), top), time, font=font(14), fill=INK)
    for row, (label, tiles) in enumerate(rows):
        y = top + 24 + row * (size[1] + GAP)
        pen.multiline_text((GAP, y), label, font=font(14), fill=INK, spacing=3)
        for column, tile in enumerate(tiles):
            x = SIDE + column * (size[0] + GAP)
            page.paste(Image.fromarray(tile), (x, y))
            pen.rectangle((x - 1, y - 1, x + size[0], y + size[1]), outline=FAINT)
    return np.asarray(page)


def _write_table(pen: ImageDraw.ImageDraw, rows: tuple[Row, ...], y: int) -> None:
    x = GAP
    for column in zip(*rows, strict=True):
        for i, cell in enumerate(column):
            pen.text((x, y + i * LINE), cell, font=font(14), fill=FAINT if i == 0 else INK)
        x += 24 + max(round(pen.textlength(cell, font=font(14))) for cell in column)


def _legend(pen: ImageDraw.ImageDraw, names: tuple[str, ...], y: int) -> None:
    x = GAP
    for i, name in enumerate(names):
        pen.rectangle((x, y + 3, x + 12, y + 15), fill=object_colour(i))
        pen.text((x + 17, y), name, font=font(14), fill=INK)
        x += 34 + round(pen.textlength(name, font=font(14)))


def _tile(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return cv2.resize(np.ascontiguousarray(picture), size, interpolation=cv2.INTER_AREA)


def _wheel(flow: np.ndarray, longest: float, size: tuple[int, int]) -> np.ndarray:
    return _tile(flow_picture(flow, "wheel", longest), size)


def outlined(picture: np.ndarray, masks: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The picture, brought to size (width, height), with the outline of each object of `masks` (H, W) in its colour, on
    a dark line that sets it off."""
    tile = _tile(picture, size)
    scale = np.array([size[0] / picture.shape[1], size[1] / picture.shape[0]])
    for i in np.unique(masks[masks > 0]):
        contours, _ = cv2.findContours((masks == i).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        lines = [np.rint((c[:, 0] + 0.5) * scale * _FINE - _FINE / 2).astype(np.int32) for c in contours]
        for colour, thickness in (((15, 15, 15), 4), (object_colour(int(i) - 1), 2)):
            cv2.polylines(tile, lines, True, colour, thickness, cv2.LINE_AA, 4)
    return tile


def _painted(picture: np.ndarray, masks: np.ndarray) -> np.ndarray:
    """The picture, pale, with each instance of `masks` (H, W) in a colour."""
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    pale = 128 + grey // 2
    colours = np.array([(0, 0, 0), *(object_colour(i) for i in range(255))], np.uint8)
    painted = np.where(masks[..., None] > 0, colours[masks] // 4 * 3 + picture // 4, pale)
    return painted.astype(np.uint8)


@functools.cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def caption(frames: np.ndarray, text: str) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 with a caption in the upper left corner, white on a dark patch."""
    own = font(CAPTION_PX)
    _, _, right, bottom = own.getbbox(text)
    width, height = round(right) + 2 * MARGIN, round(bottom) + MARGIN
    patch = Image.new("RGB", (width, height), INK)
    ImageDraw.Draw(patch).text((MARGIN, MARGIN // 2), text, font=own, fill=PAPER)
    out = frames.copy()
    height, width = min(height, frames.shape[1]), min(width, frames.shape[2])
    out[:, :height, :width] = np.asarray(patch)[:height, :width]
    return out


def side_by_side(left: np.ndarray, right: np.ndarray, captions: tuple[str, str]) -> np.ndarray:
    """Two clips (T, H, W, 3) beside each other, with a caption each."""
    between = np.full((*left.shape[:2], BETWEEN, 3), 255, np.uint8)
    return np.concatenate([caption(left, captions[0]), between, caption(right, captions[1])], axis=2)


def aligned(rows: Sequence[Row]) -> list[str]:
    """Rows as lines with columns of equal width: the first two to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [c.ljust(w) if i < 2 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return lines
