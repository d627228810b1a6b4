"""SHA-256 of files, folders and plain values."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def canonical_json(value: Any) -> str:
    """The one JSON text of a plain value: sorted keys, no spaces, no NaN.

    Raises TypeError or ValueError where the value is not plain (str, number, bool, None, list, dict).
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def hash_value(value: Any) -> str:
    """SHA-256 (hex) of a plain value's canonical JSON."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def hash_file(path: Path) -> str:
    """SHA-256 (hex) of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_files(folder: Path) -> dict[str, str]:
    """Every file under `folder`, as its path relative to it (with `/`) and its SHA-256, sorted by path."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hash_file(path) for path in files}


def hash_path(path: Path) -> str:
    """SHA-256 of a file's bytes, or of the names and bytes of all files of a folder; not of the path's own name."""
    return hash_file(path) if path.is_file() else hash_tree(hash_files(path))


def hash_tree(files: Mapping[str, str]) -> str:
    """One hash for several files, from their relative paths and hashes."""
    return hash_value(dict(files))
