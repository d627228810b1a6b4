"""One Zarr v3 group per shard: dense arrays whose leading axis is the clip, in two files an array.

The sharding codec puts all clips of an array into one file with an index, so that a single clip can be read without
the others. Equal numbers give equal bytes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from pipeline.shards.tables import ZSTD_LEVEL

_OFFSETS = "offsets"

ClipArrays = np.ndarray | Sequence[np.ndarray]
"""Either one array (clips, ...), or a list with one array per clip, which differ in their leading axis only."""


def write_arrays(arrays: Mapping[str, ClipArrays], path: Path) -> None:
    """Write a group of arrays. A list of arrays is stored end to end with its offsets."""
    group = zarr.open_group(path, mode="w", zarr_format=3)
    for name in sorted(arrays):
        _write_array(group, name, arrays[name])


def _write_array(group: zarr.Group, name: str, value: ClipArrays) -> None:
    attributes: dict[str, Any] = {}
    if isinstance(value, np.ndarray):
        values, rows_per_chunk = value, 1
    else:
        kinds = {(array.shape[1:], array.dtype) for array in value}
        assert len(kinds) == 1, f"{name}: only the leading axis may differ, not {kinds}"
        values = np.concatenate(value)
        offsets = np.cumsum([0, *(len(array) for array in value)])
        attributes[_OFFSETS] = offsets.tolist()
        rows_per_chunk = max(1, round(len(values) / len(value)))
    assert values.dtype.kind in "biuf", f"{name}: {values.dtype} is not a number or bool"
    assert values.ndim >= 1, f"{name}: no clip axis"
    values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
    row_shape = tuple(max(1, size) for size in values.shape[1:])
    chunk_count = max(1, -(-len(values) // rows_per_chunk))
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=values.dtype,
        chunks=(rows_per_chunk, *row_shape),
        shards=(rows_per_chunk * chunk_count, *row_shape),
        compressors=[ZstdCodec(level=ZSTD_LEVEL)],
        filters=None,
        fill_value=0,
        chunk_key_encoding={"name": "default", "separator": "."},  # one flat file instead of nested folders
        attributes=attributes,
        config={"write_empty_chunks": True},  # a file of zeros is written too
    )
    if values.size:
        array[...] = values


@dataclass(frozen=True)
class ArrayGroup:
    """The arrays of one shard, opened for reading; `[name]` is lazy."""

    group: zarr.Group

    def __getitem__(self, name: str) -> "ShardArray":
        array = self.group[name]
        assert isinstance(array, zarr.Array)
        offsets = array.attrs.asdict().get(_OFFSETS)
        return ShardArray(array, None if offsets is None else tuple(offsets))  # type: ignore[arg-type]

    def __contains__(self, name: str) -> bool:
        return name in self.group

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self.group.array_keys()))


@dataclass(frozen=True)
class ShardArray:
    """One array of a shard: `len` clips, `[k]` reads the k-th of them and nothing else."""

    array: zarr.Array
    offsets: tuple[int, ...] | None

    def __len__(self) -> int:
        return self.array.shape[0] if self.offsets is None else len(self.offsets) - 1

    def __getitem__(self, k: int) -> np.ndarray:
        if not 0 <= k < len(self):
            raise IndexError(k)
        if self.offsets is None:
            return np.asarray(self.array[k])
        return np.asarray(self.array[self.offsets[k] : self.offsets[k + 1]])


def open_arrays(path: Path) -> ArrayGroup:
    """Open a group for reading. Raises what zarr raises where it is missing or damaged."""
    return ArrayGroup(zarr.open_group(path, mode="r"))
