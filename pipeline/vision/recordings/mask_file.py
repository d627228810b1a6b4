"""Instance masks from files: a folder of PNGs, one PNG, or an NPZ with the key `masks`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import VideoError
from pipeline.untrusted import open_png, read_npz
from pipeline.vision.recordings.letterbox import ALIKE, Letterbox, letterbox_for

MOST_FILES = 10_000
MOST_BODIES = 255  # that masks of uint8 number
KEY, TIMES = "masks", "times"


def read_masks(path: Path | str, size: tuple[int, int], letterbox: Letterbox | None = None) -> np.ndarray:
    """Read instance masks.

    PNGs of a folder are read in the order of their names. Grey values, palette indices or colours are ids; black is the
    background.

    Args:
        path: A folder of PNGs, a PNG, or an NPZ.
        size: (width, height) of the result, px.
        letterbox: That of the clip. Masks with the shape of the recording are brought to its place, others are resized.

    Returns:
        Ids (T, H, W) uint8: 0 for the background, else 1 to N in the order of the values in the file.

    Raises:
        VideoError: The file cannot be read or the masks cannot be used.
    """
    path = Path(path)
    masks = read_values(path)
    values = np.unique(masks)
    values = values[values != 0]
    if not len(values):
        raise VideoError(f"{path}: the masks are empty (all background)")
    if len(values) > MOST_BODIES:
        raise VideoError(
            f"{path} has {len(values)} different ids, at most {MOST_BODIES} are possible: is it a picture?"
        )
    ids = np.where(masks == 0, 0, np.searchsorted(values, masks) + 1).astype(np.uint8)
    own = (ids.shape[2], ids.shape[1])
    if letterbox is not None and abs(own[0] * letterbox.source[1] / (own[1] * letterbox.source[0]) - 1) < ALIKE:
        return sized(ids, letterbox.size)
    return np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST_EXACT) for m in ids])


def sized(ids: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Ids (T, H, W) in another size (width, height), px, as the letterbox shows them."""
    letterbox = letterbox_for((ids.shape[2], ids.shape[1]), size)
    return np.stack([letterbox.apply(m, nearest=True) for m in ids])


def renumbered(ids: np.ndarray) -> np.ndarray:
    """The ids (T, H, W) uint8 that are left, as 1 to N in their order; 0 stays."""
    there = np.bincount(ids.ravel(), minlength=256) > 0
    there[0] = False
    return np.where(there, np.cumsum(there), 0).astype(np.uint8)[ids]


def only(ids: np.ndarray, kept: Sequence[int]) -> np.ndarray:
    """The ids (T, H, W) uint8 that are kept, as 1 to N in the order given, seen or not; 0 elsewhere."""
    table = np.zeros(256, np.uint8)
    table[list(kept)] = np.arange(1, len(kept) + 1)
    return np.asarray(table[ids])


def read_times(path: Path) -> np.ndarray | None:
    """When each mask of an NPZ was recorded, s from the beginning of the video, where it says so."""
    if path.suffix.lower() != ".npz":
        return None
    check_there(path)
    times = read_npz(path, (TIMES,), VideoError).get(TIMES)
    if times is not None and (times.ndim != 1 or times.dtype.kind not in "biuf"):
        raise VideoError(f"{path}: `{TIMES}` is {times.dtype} {times.shape}, not numbers (T,)")
    return None if times is None else times.astype(float)


def check_there(path: Path) -> None:
    if not path.exists():
        raise VideoError(f"{path}: there are no masks there; valid: a folder of PNGs, a PNG, or an NPZ with `{KEY}`")


def read_values(path: Path) -> np.ndarray:
    """The values in a file or folder, (T, H, W) integers."""
    check_there(path)
    if path.is_dir():
        files = sorted(p for p in path.iterdir() if p.suffix.lower() == ".png")
        if not files:
            raise VideoError(f"{path} has no PNG files")
        if len(files) > MOST_FILES:
            raise VideoError(f"{path} has {len(files)} PNG files; at most {MOST_FILES} are read")
        pictures = [read_png(p) for p in files]
        sizes = {p.shape for p in pictures}
        if len(sizes) > 1:
            raise VideoError(f"{path}: the PNGs have {len(sizes)} different sizes")
        return np.stack(pictures)
    if path.suffix.lower() == ".png":
        return read_png(path)[None]
    if path.suffix.lower() == ".npz":
        return read_archive(path)
    raise VideoError(f"{path} is no mask file; valid: a folder of PNGs, a PNG, or an NPZ with `{KEY}`")


def read_png(path: Path) -> np.ndarray:
    """Values (H, W) int64: grey value, palette index, or the colour as one number; 0 where transparent."""
    with open_png(path, VideoError) as image:
        if image.mode in ("RGBA", "LA", "PA"):
            values = np.asarray(image.convert("RGBA")).astype(np.int64)
            return np.where(values[..., 3] > 0, values[..., :3] @ [65536, 256, 1], 0)
        values = np.asarray(image).astype(np.int64)
    return values if values.ndim == 2 else values @ np.array([65536, 256, 1])


def read_archive(path: Path) -> np.ndarray:
    masks = read_npz(path, (KEY,), VideoError).get(KEY)
    if masks is None:
        raise VideoError(f"{path} has no array `{KEY}`")
    if masks.ndim == 2:
        masks = masks[None]
    if masks.ndim != 3 or masks.dtype.kind not in "biu":
        raise VideoError(f"{path}: `{KEY}` is {masks.dtype} {masks.shape}, not integers (T, H, W)")
    return masks.astype(np.int64)
