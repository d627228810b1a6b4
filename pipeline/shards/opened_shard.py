"""A shard opened for reading: all clips of it, or a run of them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from pipeline.errors import ShardError
from pipeline.shards.arrays import ArrayGroup, ShardArray, open_arrays
from pipeline.shards.content_hash import hash_file
from pipeline.shards.manifest import ARRAYS, ShardEntry, how_to_mend, placed_name, stored_name
from pipeline.shards.shard import MAIN_TABLE
from pipeline.shards.tables import CLIP_COLUMN, read_table

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class OpenShard:
    """A view of some clips of one shard of a folder. Nothing is read before it is asked for.

    A file is hashed before it is read for the first time.

    Files that are missing or damaged raise ShardError, which names the file and what to run.

    Attributes:
        folder: The stage's output folder.
        entry: The shard's entry of the manifest.
        tables: The names of its tables.
        arrays: The names of its arrays.
        start: The first clip of the view.
        stop: The clip after the last one.
        stored: The shard's folder in the store, from which is read where data/ is on another machine.
    """

    folder: Path
    entry: ShardEntry
    tables: tuple[str, ...]
    arrays: tuple[str, ...]
    start: int
    stop: int
    stored: Path | None = None

    @property
    def clips(self) -> range:
        return range(self.start, self.stop)

    def __len__(self) -> int:
        return self.stop - self.start

    def table(self, name: str = MAIN_TABLE) -> pa.Table:
        """The rows of these clips."""
        return self._rows_between(name, self.start, self.stop)

    def rows(self, clip: int, name: str = MAIN_TABLE) -> list[dict[str, Any]]:
        """The rows of one clip."""
        self._check_clip(clip)
        return self._rows_between(name, clip, clip + 1).to_pylist()

    def row(self, clip: int, name: str = MAIN_TABLE) -> dict[str, Any]:
        """The one row of a clip. Raises ShardError where there is not exactly one."""
        rows = self.rows(clip, name)
        if len(rows) != 1:
            raise ShardError(f"{self.table_path(name)}: clip {clip} has {len(rows)} rows, not 1")
        return rows[0]

    def array(self, clip: int, name: str) -> np.ndarray:
        """One clip's array; the others are not read."""
        self._check_clip(clip)
        path = self.array_path(name)
        return self._guarded(path, lambda: self._array(name)[clip - self.entry.start])

    def narrowed(self, start: int, stop: int) -> "OpenShard":
        """A view of fewer of its clips."""
        assert self.start <= start <= stop <= self.stop
        return replace(self, start=start, stop=stop)

    def in_store(self, folder: Path) -> "OpenShard":
        """The same, read from the store."""
        return replace(self, stored=folder)

    def verify(self) -> None:
        """Hash every file. Raises ShardError for one that is missing or not what the manifest says."""
        self._verify(self.entry.files)

    def table_path(self, name: str = MAIN_TABLE) -> Path:
        if name not in self.tables:
            raise ShardError(f"{self.folder} has no table `{name}`; it has {list(self.tables)}")
        return self._path(placed_name(f"{name}.parquet", self.entry.name))

    def array_path(self, name: str) -> Path:
        if name not in self.arrays:
            raise ShardError(f"{self.folder} has no array `{name}`; it has {list(self.arrays)}")
        return self._path(placed_name(f"{ARRAYS}/{name}", self.entry.name))

    def _path(self, placed: str) -> Path:
        if self.stored is not None:
            return self.stored / stored_name(placed, self.entry.name)
        return self.folder / placed

    def _rows_between(self, name: str, start: int, stop: int) -> pa.Table:
        path = self.table_path(name)
        self._verify([placed_name(f"{name}.parquet", self.entry.name)])
        table, clips = self._guarded(path, lambda: _table_and_clips(path, path.stat().st_mtime_ns))
        first, last = np.searchsorted(clips, (start, stop))
        return table.slice(first, last - first)

    def _array(self, name: str) -> ShardArray:
        group, own = (placed_name(f"{ARRAYS}/{part}", self.entry.name) for part in ("zarr.json", f"{name}/"))
        self._verify([file for file in self.entry.files if file == group or file.startswith(own)])
        return self._group[name]

    def _verify(self, files: Iterable[str]) -> None:
        """Hash files, each once per process as long as it does not change."""
        for name in files:
            path = self._path(name)
            if not self._guarded(path, partial(_is_sound, path, self.entry.files[name])):
                raise ShardError(f"{path} is damaged (its hash is not the manifest's); {how_to_mend(self.folder)}")

    @cached_property
    def _group(self) -> ArrayGroup:
        return open_arrays(self._path(placed_name(ARRAYS, self.entry.name)))

    def _check_clip(self, clip: int) -> None:
        if clip not in self.clips:
            here = f"{self.entry.name} of {self.folder} ({self.start} to {self.stop - 1})"
            raise IndexError(f"clip {clip} is not in {here}")

    def _guarded(self, path: Path, read: Callable[[], T]) -> T:
        try:
            return read()
        except (OSError, ValueError, RuntimeError, KeyError) as error:  # what pyarrow, zarr and numcodecs raise
            state = "damaged" if path.exists() else "missing"
            raise ShardError(f"{path} is {state} ({error}); {how_to_mend(self.folder)}") from error


def _is_sound(path: Path, expected: str) -> bool:
    state = path.stat()
    return _hash_of(path, state.st_ino, state.st_ctime_ns, state.st_size) == expected


@lru_cache(maxsize=100_000)
def _hash_of(path: Path, _inode: int, _ctime_ns: int, _size: int) -> str:
    return hash_file(path)


@lru_cache(maxsize=8)
def _table_and_clips(path: Path, _mtime_ns: int) -> tuple[pa.Table, np.ndarray]:
    table = read_table(path)
    return table, table.column(CLIP_COLUMN).to_numpy()
