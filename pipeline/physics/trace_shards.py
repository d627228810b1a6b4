"""Traces in shards: arrays of states and a table of contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from pipeline.physics.trace import Contacts, Trace
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.shards.opened_shard import OpenShard

STATE_NAMES = ("position", "quaternion", "velocity", "angular_velocity")
_VECTORS = ("position", "normal", "force")
CONTACT_SCHEMA = pa.schema(
    {"clip": pa.int64(), "step": pa.int32(), "first": pa.int8(), "second": pa.int8(), "distance": pa.float64()}
    | {name: pa.list_(pa.float64(), 3) for name in _VECTORS}
)


def trace_arrays(traces: Sequence[Trace]) -> dict[str, list[np.ndarray]]:
    """Arrays (N, S + 1, 3 or 4) by name, one per trace. The number of objects is the first axis because it varies."""
    return {name: [np.ascontiguousarray(getattr(t, name).swapaxes(0, 1)) for t in traces] for name in STATE_NAMES}


def contact_table(clip: int, trace: Trace) -> pa.Table:
    """The contacts of a clip, one per row."""
    c = trace.contacts
    columns: dict[str, pa.Array] = {
        "clip": pa.array(np.full(len(c), clip)),
        "step": pa.array(c.step.astype(np.int32)),
        "first": pa.array(c.first.astype(np.int8)),
        "second": pa.array(c.second.astype(np.int8)),
        "distance": pa.array(c.distance),
    }
    for name in _VECTORS:
        columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(getattr(c, name).ravel()), 3)
    return pa.table(columns, schema=CONTACT_SCHEMA)


def read_trace(shard: OpenShard, clip: int) -> Trace:
    """The trace of one clip of a `simulate` shard."""
    table = _rows(shard, clip)
    vectors = {name: table.column(name).combine_chunks().flatten().to_numpy().reshape(-1, 3) for name in _VECTORS}
    contacts = Contacts(
        step=table.column("step").to_numpy().astype(int),
        first=table.column("first").to_numpy().astype(int),
        second=table.column("second").to_numpy().astype(int),
        distance=table.column("distance").to_numpy(),
        **vectors,
    )
    states = {name: np.ascontiguousarray(shard.array(clip, name).swapaxes(0, 1)) for name in STATE_NAMES}
    return Trace(STEPS_PER_SECOND, **states, contacts=contacts)


def _rows(shard: OpenShard, clip: int) -> pa.Table:
    return shard.narrowed(clip, clip + 1).table("contacts")
