"""A shard: a fixed run of clips, and what a stage computes for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from pipeline.shards.arrays import ClipArrays
from pipeline.shards.tables import CLIP_COLUMN

MAIN_TABLE = "clips"


@dataclass(frozen=True)
class Shard:
    """Clips start to stop - 1 of a suite; independent of how many shards there are."""

    stage: str
    suite: str
    start: int
    stop: int

    @property
    def clips(self) -> range:
        return range(self.start, self.stop)

    def __len__(self) -> int:
        return self.stop - self.start

    def __str__(self) -> str:
        return f"{self.stage} {self.suite}, clips {self.start} to {self.stop - 1}"


@dataclass(frozen=True)
class ShardResult:
    """What a stage computes for a shard.

    Attributes:
        tables: Each has an integer column `clip`: clips of the shard, never decreasing. The one named "clips" becomes
            shard-….parquet, any other <name>/shard-….parquet.
        arrays: (clips, ...) arrays, or lists with one array per clip, whose leading axes may differ.
        notes: Counts for the line of outcome and the manifest ("rejected: overlap": 12), added up over the shards.
    """

    tables: Mapping[str, pa.Table] = field(default_factory=dict)
    arrays: Mapping[str, ClipArrays] = field(default_factory=dict)
    notes: Mapping[str, int | float] = field(default_factory=dict)

    def check(self, shard: Shard) -> None:
        """Assert that the result has the shard's clips and nothing else."""
        assert self.tables or self.arrays, f"{shard}: an empty result"
        for name, table in self.tables.items():
            assert CLIP_COLUMN in table.column_names, f"{shard}: the table {name} has no column `{CLIP_COLUMN}`"
            clips = table.column(CLIP_COLUMN).to_numpy()
            assert np.issubdtype(clips.dtype, np.integer), f"{shard}: `{CLIP_COLUMN}` of {name} is {clips.dtype}"
            assert (np.diff(clips) >= 0).all(), f"{shard}: the rows of {name} are not in the order of the clips"
            outside = set(clips.tolist()) - set(shard.clips)
            assert not outside, f"{shard}: rows of {name} are of other clips: {sorted(outside)[:5]}"
        for name, array in self.arrays.items():
            assert len(array) == len(shard), f"{shard}: the array {name} has {len(array)} clips, not {len(shard)}"
