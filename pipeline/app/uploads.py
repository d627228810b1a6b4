"""Files that a visitor sends: bounded before they are read, and kept under names of ours."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import DynamicsError
from pipeline.untrusted import MOST_TEXT_BYTES
from pipeline.vision.recordings.clip_folder import VIDEO_SUFFIXES

CHUNK = 2**20
MOST_NAME = 80  # characters


class UploadError(DynamicsError):
    """A file that is not taken."""


@dataclass(frozen=True)
class UploadKind:
    """What may be sent: its title, the endings of names, and the most bytes."""

    title: str
    suffixes: tuple[str, ...]
    most_bytes: int


KINDS = {
    "clip": UploadKind("video", VIDEO_SUFFIXES, 500 * 2**20),
    "table": UploadKind("table of measured motion", (".csv", ".parquet"), 64 * 2**20),
    "scene": UploadKind("scene", (".yaml", ".yml"), MOST_TEXT_BYTES),
}


def check_upload(kind: str, name: str, length: int) -> str:
    """The ending of the file's name. Raises UploadError for another kind of file, and for one that is too large."""
    wanted = KINDS.get(kind)
    if wanted is None:
        raise UploadError(f"{kind!r} is not taken; valid: {', '.join(KINDS)}")
    suffix = Path(name).suffix.lower()
    if suffix not in wanted.suffixes:
        raise UploadError(f"{shown_name(name)} is no {wanted.title}; valid: {', '.join(wanted.suffixes)}")
    if length > wanted.most_bytes:
        most = wanted.most_bytes // 2**20
        raise UploadError(f"{shown_name(name)} has {length / 2**20:,.0f} MiB; at most {most} MiB are taken")
    if length <= 0:
        raise UploadError(f"{shown_name(name)} is empty")
    return suffix


def receive(stream: BinaryIO, length: int, place: Path) -> None:
    """Write exactly `length` bytes of a stream to a new file; nothing of it is left where the stream ends before."""
    try:
        with place.open("xb") as file:
            left = length
            while left:
                data = stream.read(min(CHUNK, left))
                if not data:
                    raise UploadError("the upload broke off; try again")
                file.write(data)
                left -= len(data)
    except BaseException:
        place.unlink(missing_ok=True)
        raise


def shown_name(name: str) -> str:
    """A file's name for messages and for us: its last part, without control characters, not long."""
    last = re.sub(r"[^\w .()+-]", "_", os.path.basename(name.replace("\\", "/"))).lstrip(". ")
    stem, dot, suffix = last.rpartition(".")
    return f"{stem[: MOST_NAME - 10]}{dot}{suffix[:9]}" or "file"
