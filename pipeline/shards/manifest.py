"""What a stage's output folder holds: `manifest.json`, written last.

It has no times, no worker counts and no absolute paths, so that the same work gives the same bytes. Its `checksum` is
the hash of all its other fields.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import ShardError
from pipeline.shards.checksum import checked_fields, with_checksum
from pipeline.shards.shard import MAIN_TABLE

MANIFEST = "manifest.json"
ARRAYS = "arrays.zarr"  # as it is called in the store


@dataclass(frozen=True, kw_only=True)
class ShardEntry:
    """One shard of a stage's output folder.

    Attributes:
        name: As shard-00000-of-00004.
        start: The first clip.
        stop: The clip after the last one.
        key: Its key in the store.
        content: One hash of all its files.
        inputs: Name of an input, as sample/train -> `content` of the shard that was read of it.
        files: Path in the folder -> SHA-256 of the file.
        notes: Counts, in the order of their names.
    """

    name: str
    start: int
    stop: int
    key: str
    content: str
    inputs: Mapping[str, str]
    files: Mapping[str, str]
    notes: Mapping[str, int | float]


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What `manifest.json` has.

    Attributes:
        stage: The stage's name.
        suite: The suite's name.
        clips: How many clips.
        tables: The names of the tables that every shard has.
        arrays: The names of the arrays that every shard has.
        notes: The shards' notes, added up.
        parts: What the keys of the shards have in common: code, parameters, versions. A shard's key is made of these
            and of its stage, suite, clips and inputs.
        shards: In the order of their clips, which they cover without a gap.
    """

    stage: str
    suite: str
    clips: int
    tables: tuple[str, ...]
    arrays: tuple[str, ...]
    notes: Mapping[str, int | float]
    parts: Mapping[str, Any]
    shards: tuple[ShardEntry, ...]

    def write(self, folder: Path) -> None:
        temporary = folder / f".{MANIFEST}.{os.getpid()}"
        fields = asdict(self)
        text = json.dumps(with_checksum(fields), indent=1, ensure_ascii=False)
        temporary.write_text(text + "\n", encoding="utf-8")
        temporary.rename(folder / MANIFEST)


def read_manifest(folder: Path) -> Manifest:
    """Read a stage's manifest. Raises ShardError where it is missing, damaged or no manifest."""
    path = folder / MANIFEST
    try:
        fields = checked_fields(json.loads(path.read_bytes()))
        shards = tuple(ShardEntry(**entry) for entry in fields.pop("shards"))
        return Manifest(
            **{**fields, "tables": tuple(fields["tables"]), "arrays": tuple(fields["arrays"])}, shards=shards
        )
    except (FileNotFoundError, NotADirectoryError):
        raise ShardError(f"{path} is missing; {how_to_mend(folder)}") from None
    except (OSError, RecursionError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ShardError(f"{path} is damaged or not a manifest of shards ({error}); {how_to_mend(folder)}") from error


def how_to_mend(folder: Path) -> str:
    """What to run where something in `folder` is missing or damaged."""
    return f"run `dynamics store fsck` to mend it from another copy, or `dvc repro` to make it ({folder})"


def total_notes(notes: Iterable[Mapping[str, int | float]]) -> dict[str, int | float]:
    """Notes added up by name, in the order of the names."""
    total: dict[str, int | float] = {}
    for counts in notes:
        for name, count in counts.items():
            total[name] = total.get(name, 0) + count
    return dict(sorted(total.items()))


def notes_text(notes: Mapping[str, int | float]) -> str:
    """Notes as the end of a line of outcome: `; rejected 36, accepted 4`, or nothing."""
    return "; " * bool(notes) + ", ".join(f"{name} {value:g}" for name, value in notes.items())


def shard_name(index: int, count: int) -> str:
    return f"shard-{index:05d}-of-{count:05d}"


def placed_name(stored: str, shard: str) -> str:
    """Where a file of the store goes in the output folder: `clips.parquet` to `shard-00000-of-00004.parquet`."""
    group, slash, inside = stored.partition("/")
    if group == ARRAYS:
        return f"{shard}.zarr{slash}{inside}"
    table = stored.removesuffix(".parquet")
    return f"{shard}.parquet" if table == MAIN_TABLE else f"{table}/{shard}.parquet"


def stored_name(placed: str, shard: str) -> str:
    """What the store calls a file of the output folder; the inverse of `placed_name`."""
    table, slash, inside = placed.partition("/")
    if table == f"{shard}.zarr":
        return f"{ARRAYS}{slash}{inside}"
    return f"{table if slash else MAIN_TABLE}.parquet"
