"""A stage's output, read clip by clip."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.shards.manifest import Manifest, read_manifest
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import MAIN_TABLE
from pipeline.shards.store import SECONDS, Store, default_store


@dataclass(frozen=True)
class Clip:
    """One clip of a dataset; each call reads what it asks for."""

    index: int
    shard: OpenShard

    def row(self, table: str = MAIN_TABLE) -> dict[str, Any]:
        """Its only row of a table."""
        return self.shard.row(self.index, table)

    def rows(self, table: str = MAIN_TABLE) -> list[dict[str, Any]]:
        """Its rows of a table."""
        return self.shard.rows(self.index, table)

    def array(self, name: str) -> np.ndarray:
        """Its part of an array."""
        return self.shard.array(self.index, name)


class ShardedDataset:
    """The clips of a folder of shards: `len`, iteration, and `[index]`, all lazy."""

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        self.folder = folder
        self.manifest = manifest
        self.shards = tuple(
            OpenShard(
                folder=folder,
                entry=entry,
                tables=manifest.tables,
                arrays=manifest.arrays,
                start=entry.start,
                stop=entry.stop,
            )
            for entry in manifest.shards
        )
        self._starts = [shard.start for shard in self.shards]

    def __len__(self) -> int:
        return self.manifest.clips

    def __getitem__(self, index: int) -> Clip:
        if not 0 <= index < len(self):
            raise IndexError(f"{self.folder} has the clips 0 to {len(self) - 1}, not {index}")
        return Clip(index, self.shards[bisect_right(self._starts, index) - 1])

    def __iter__(self) -> Iterator[Clip]:
        return (Clip(index, shard) for shard in self.shards for index in shard.clips)

    def table(self, name: str = MAIN_TABLE) -> pa.Table:
        """A table of all clips."""
        return pa.concat_tables([shard.table(name) for shard in self.shards])

    def compute_seconds(self, store: Store | None = None) -> float | None:
        """Seconds of one worker behind all shards; None where the store no longer has one of them."""
        store = store or default_store()
        records = [store.record_of(shard.entry.key) or {} for shard in self.shards]
        seconds = [record.get("parts", {}).get(SECONDS) for record in records]
        return None if None in seconds else float(sum(seconds))

    def verify(self) -> None:
        """Hash every file; raises ShardError for the first that is missing or damaged."""
        for shard in self.shards:
            shard.verify()


def open_shards(folder: Path | str) -> ShardedDataset:
    """Open a stage's output folder, data/<stage>/<suite>. Raises ShardError for a missing or damaged manifest."""
    folder = Path(folder)
    return ShardedDataset(folder, read_manifest(folder))
