"""The output folder of a stage, made from the files of the store: whole or not at all."""

import fcntl
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import OutputError
from pipeline.shards.beside import beside, put_in_place
from pipeline.shards.manifest import ARRAYS, MANIFEST, Manifest, ShardEntry, placed_name, shard_name, total_notes
from pipeline.shards.output_errors import writing_to
from pipeline.shards.shard import Shard
from pipeline.shards.store import StoredShard

_SHARD_NAME = re.compile(r"shard-\d{5,}-of-\d{5,}\.(parquet|zarr)")
_FICLONE = 0x40049409  # linux/fs.h


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
            raise OutputError(f"{folder} holds {path.name}, which is not a shard and would be lost: move it away")


def write_output(
    folder: Path, stage: str, suite: str, shards: Sequence[FilledShard], parts: Mapping[str, Any]
) -> Manifest:
    """Write a stage's output folder, with the manifest last.

    Args:
        folder: The folder; what is there before is replaced.
        stage: The stage's name.
        suite: The suite's name.
        shards: All shards in the order of their clips.
        parts: What their keys have in common (`keys.common_parts`).

    Returns:
        The manifest.

    Raises:
        OutputError: The folder cannot be written; what was there before is then still there.
    """
    tables, arrays = _contents(shards)
    with replacing(folder) as temporary:
        entries = tuple(_place_shard(temporary, k, len(shards), shard) for k, shard in enumerate(shards))
        manifest = Manifest(
            stage=stage,
            suite=suite,
            clips=shards[-1].shard.stop if shards else 0,
            tables=tables,
            arrays=arrays,
            notes=total_notes(entry.notes for entry in entries),
            parts=parts,
            shards=entries,
        )
        manifest.write(temporary)
    return manifest


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """An empty folder beside `folder`, which takes its place at the end; after an error `folder` is as it was.

    Raises OutputError where that cannot be written.
    """
    with writing_to(folder), beside(folder.absolute()) as temporary:
        yield temporary
        put_in_place(temporary, folder.absolute())


def place(source: Path, target: Path) -> None:
    """Make `target` (which must not exist) the same file as `source`; folders are made as needed.

    By reflink where the file system has them, else by hard link, else by copy. A hard link shares its bytes with the
    store. That is safe because nothing here writes in place: files are made under a temporary name and renamed, and
    are read-only from then on (DVC makes them so too); DVC removes an output instead of overwriting it; and where
    somebody does write in place, the store notices it by the hash and computes the shard again. A copy would take the
    disk space twice, and DVC would hash it again (its record is by inode and time).
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    if not (_reflink(source, target) or _hard_link(source, target)):
        shutil.copyfile(source, target)
        target.chmod(0o444)


def _reflink(source: Path, target: Path) -> bool:
    try:
        with open(source, "rb") as original, open(target, "xb") as clone:
            fcntl.ioctl(clone.fileno(), _FICLONE, original.fileno())
    except OSError:
        target.unlink(missing_ok=True)
        return False
    target.chmod(0o444)
    return True


def _hard_link(source: Path, target: Path) -> bool:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        return False
    return True


def _place_shard(folder: Path, index: int, count: int, shard: FilledShard) -> ShardEntry:
    name, stored = shard_name(index, count), shard.stored
    files = {placed_name(file, name): digest for file, digest in stored.files.items()}
    for source, target in zip(stored.files, files, strict=True):
        place(stored.folder / source, folder / target)
    return ShardEntry(
        name=name,
        start=shard.shard.start,
        stop=shard.shard.stop,
        key=stored.key,
        content=stored.content,
        inputs=shard.inputs,
        files=files,
        notes=stored.notes,
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
