"""masks.png: moments of a clip with the outline, the number and the score of each body that was found."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from pipeline.api.overlay import FAINT, GAP, INK, LINE, PAPER, font, outlined
from pipeline.bodies.user_clip import UserClip
from pipeline.inference.measure_clip import summary
from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.recordings.video import AREA
from pipeline.vision.rendering.appearance import object_colour

SHEET = "masks.png"
COLUMNS, MOMENTS = 4, 8
LETTERS = 190  # of a line of the heading


def write_sheet(folder: Path, name: str, taken: UserClip) -> None:
    """Write masks.png."""
    Image.fromarray(mask_sheet(Path(name).name, taken)).save(folder / SHEET)


def mask_sheet(name: str, taken: UserClip) -> np.ndarray:
    """The picture, (H, W, 3) uint8, of a clip of that name."""
    clip, masks = (taken.clip, taken.masks) if taken.found is None else (taken.found.clip, taken.found.masks)
    labels = [f" {b.label}" for b in taken.found.bodies] if taken.found else [""] * taken.objects
    chosen = np.unique(np.rint(np.linspace(0, len(masks) - 1, MOMENTS)).astype(int))
    tile = of_area((masks.shape[2], masks.shape[1]), AREA)
    heading = [f"{name}: {summary(taken)}", *(taken.found.notes if taken.found else ()), *taken.doubts]
    lines = [line for text in heading for line in textwrap.wrap(text, LETTERS)]
    columns = min(COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    top = GAP + LINE * len(lines) + GAP
    page = Image.new("RGB", (GAP + columns * (tile[0] + GAP), top + rows * (tile[1] + LINE + GAP)), PAPER)
    pen = ImageDraw.Draw(page)
    for i, line in enumerate(lines):
        pen.text((GAP, GAP + i * LINE), line, font=font(14), fill=INK)
    for i, t in enumerate(chosen):
        x, y = GAP + i % columns * (tile[0] + GAP), top + i // columns * (tile[1] + LINE + GAP)
        pen.text((x, y), f"t = {clip.source_times[t]:.2f} s", font=font(14), fill=FAINT)
        page.paste(Image.fromarray(labelled(clip.frames[t], masks[t], labels, tile)), (x, y + LINE))
    return np.asarray(page)


def labelled(picture: np.ndarray, masks: np.ndarray, labels: list[str], size: tuple[int, int]) -> np.ndarray:
    """A picture with outline, number and label of each body of masks (H, W), brought to size (width, height), px."""
    shown = Image.fromarray(outlined(picture, masks, size))
    pen = ImageDraw.Draw(shown)
    for k, label in enumerate(labels, 1):
        rows, cols = np.nonzero(masks == k)
        if not len(rows):
            continue
        x = float(cols.max() + 1) * size[0] / masks.shape[1] + 4
        y = float(rows.min()) * size[1] / masks.shape[0] - 4
        text = f"{k}{label}"
        wide = pen.textlength(text, font=font(14))
        place = (min(x, size[0] - wide - 2), float(np.clip(y, 0, size[1] - 18)))
        pen.text(place, text, font=font(14), fill=object_colour(k - 1), stroke_width=2, stroke_fill=(15, 15, 15))
    return np.asarray(shown)


def overlay_frames(frames: np.ndarray, masks: np.ndarray, labels: list[str], most_width: int = 1280) -> np.ndarray:
    """Frames (T, H, W, 3) with what `labelled` draws, at most so wide."""
    scale = min(1.0, most_width / frames.shape[2])
    size = (round(frames.shape[2] * scale), round(frames.shape[1] * scale))
    return np.stack([labelled(f, m, labels, size) for f, m in zip(frames, masks, strict=True)])
