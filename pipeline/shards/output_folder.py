"""Making a stage's output folder from shards of the store: whole or not at all."""

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import OutputError
from pipeline.shards.manifest import ARRAYS, MANIFEST, Manifest, ShardEntry, placed_name, shard_name, total_notes
from pipeline.shards.output_errors import writing_to
from pipeline.shards.placement import place
from pipeline.shards.shard import Shard
from pipeline.shards.store import StoredShard

_SHARD_NAME = re.compile(r"shard-\d{5,}-of-\d{5,}\.(parquet|zarr)")


@dataclass(frozen=True)
class FilledShard:
    """A shard, the content hashes of its inputs, and what the store has for it."""

    shard: Shard
    inputs: Mapping[str, str]
    stored: StoredShard


def check_replaceable(folder: Path) -> None:
    """Raise OutputError where `folder` holds anything that is not ours to replace."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise OutputError(f"{folder} is a file; the shards go into a folder of that name")
    for path in folder.iterdir():
        tables = path.is_dir() and all(_SHARD_NAME.fullmatch(file.name) for file in path.iterdir())
        if path.name != MANIFEST and not _SHARD_NAME.fullmatch(path.name) and not tables:
            raise OutputError(f"{folder} holds {path.name}, which is no shard; it would be lost: move it away")


def write_output(
    folder: Path, stage: str, suite: str, shards: Sequence[FilledShard], parts: Mapping[str, Any]
) -> Manifest:
    """Build the folder under a temporary name beside its place, manifest last, and rename it.

    Raises OutputError where that cannot be written; what was there before is then still there.
    """
    tables, arrays = _contents(shards)
    temporary = folder.absolute().parent / f".{folder.name}.partial"
    with writing_to(folder):
        temporary.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(temporary, ignore_errors=True)  # of a run that was killed
        try:
            temporary.mkdir()
            entries = tuple(_place_shard(temporary, k, len(shards), shard) for k, shard in enumerate(shards))
            clips = shards[-1].shard.stop if shards else 0
            notes = total_notes(entry.notes for entry in entries)
            manifest = Manifest(stage, suite, clips, tables, arrays, notes, parts, entries)
            manifest.write(temporary)
            if folder.exists():
                shutil.rmtree(folder)
            temporary.rename(folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return manifest


def _place_shard(folder: Path, index: int, count: int, shard: FilledShard) -> ShardEntry:
    name, stored = shard_name(index, count), shard.stored
    files = {placed_name(file, name): digest for file, digest in stored.files.items()}
    for source, target in zip(stored.files, files, strict=True):
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        place(stored.folder / source, folder / target)
    return ShardEntry(
        name, shard.shard.start, shard.shard.stop, stored.key, stored.content, shard.inputs, files, stored.notes
    )


def _contents(shards: Sequence[FilledShard]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of the tables and arrays. Asserts that all shards have the same, and each table one schema."""
    names: set[tuple[tuple[str, ...], tuple[str, ...]]] = set()
    schemas: dict[str, pa.Schema] = {}
    for shard in shards:
        files = shard.stored.files
        tables = tuple(sorted(file.removesuffix(".parquet") for file in files if file.endswith(".parquet")))
        prefix, suffix = f"{ARRAYS}/", "/zarr.json"
        inside = (file.removeprefix(prefix) for file in files if file.startswith(prefix) and file.count("/") == 2)
        names.add((tables, tuple(sorted(file.removesuffix(suffix) for file in inside if file.endswith(suffix)))))
        for table in tables:
            schema = pq.read_schema(shard.stored.folder / f"{table}.parquet")
            assert schema.equals(schemas.setdefault(table, schema)), f"{shard.shard}: another schema of {table}"
    assert len(names) <= 1, f"the shards hold different tables or arrays: {sorted(names)}"
    return next(iter(names), ((), ()))
