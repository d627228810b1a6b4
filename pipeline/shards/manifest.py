"""What a stage's output folder holds: `manifest.json`, written last.

It has no times, no worker counts and no absolute paths, so that the same work gives the same bytes.
"""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import ShardError
from pipeline.shards.shard import MAIN_TABLE

MANIFEST = "manifest.json"
ARRAYS = "arrays.zarr"  # as it is called in the store


@dataclass(frozen=True)
class ShardEntry:
    """One shard: its clips, its key, one hash of its content, and the SHA-256 of each of its files."""

    name: str  # shard-00000-of-00004
    start: int
    stop: int
    key: str
    content: str
    inputs: Mapping[str, str]  # "sample/train" -> content hash of the input shard
    files: Mapping[str, str]
    notes: Mapping[str, int | float]


@dataclass(frozen=True)
class Manifest:
    """The shards of a stage and suite in the order of their clips, which they cover without a gap.

    `parts` is what the keys have in common, readable: code, parameters, versions. With a shard's own stage,
    suite, clips and inputs it makes up its key.
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
        temporary.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        temporary.rename(folder / MANIFEST)


def read_manifest(folder: Path) -> Manifest:
    """Read a stage's manifest. Raises ShardError where it is missing or is none."""
    path = folder / MANIFEST
    try:
        fields = json.loads(path.read_bytes())
        shards = tuple(ShardEntry(**entry) for entry in fields.pop("shards"))
        return Manifest(
            **{**fields, "tables": tuple(fields["tables"]), "arrays": tuple(fields["arrays"])}, shards=shards
        )
    except (FileNotFoundError, NotADirectoryError):
        raise ShardError(f"{path} is missing; {how_to_mend(folder)}") from None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ShardError(f"{path} is not a manifest of shards ({error}); {how_to_mend(folder)}") from error


def how_to_mend(folder: Path) -> str:
    """What to run where something in `folder` is missing or damaged."""
    return f"run `dvc checkout --force {folder}`, or `dvc repro` to make it"


def total_notes(notes: Iterable[Mapping[str, int | float]]) -> dict[str, int | float]:
    """Notes added up by name, in the order of the names."""
    total: dict[str, int | float] = {}
    for counts in notes:
        for name, count in counts.items():
            total[name] = total.get(name, 0) + count
    return dict(sorted(total.items()))


def shard_name(index: int, count: int) -> str:
    return f"shard-{index:05d}-of-{count:05d}"


def placed_name(stored: str, shard: str) -> str:
    """Where a file of the store goes in the output folder: `clips.parquet` to `shard-00000-of-00004.parquet`."""
    if stored.startswith(f"{ARRAYS}/"):
        return f"{shard}.zarr/{stored.removeprefix(f'{ARRAYS}/')}"
    table = stored.removesuffix(".parquet")
    return f"{shard}.parquet" if table == MAIN_TABLE else f"{table}/{shard}.parquet"
