"""Events of clips from their traces, and the sentences that describe them.

Reads data/sample/<suite> and data/simulate/<suite>. Writes data/events/<suite>: table events (clip, time, kind,
first, second: object indices, of `hits_fixed` the fixed body's, -1 for none), table clips (clip, think). Parameters:
clip, events, sample.filters.visible_px. Run: python -m stages.events SUITE
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.clips.events import Thresholds, find_events
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import event_areas
from pipeline.model.language.completion import think_text
from pipeline.physics.trace_shards import read_trace
from pipeline.scene.text import read_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

EVENT_SCHEMA = pa.schema(
    {"clip": pa.int64(), "time": pa.float64(), "kind": pa.string(), "first": pa.int8(), "second": pa.int8()}
)
CLIP_SCHEMA = pa.schema({"clip": pa.int64(), "think": pa.string()})


@dataclass(frozen=True)
class Parameters:
    schedule: Schedule
    thresholds: Thresholds


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    sample, simulated = inputs
    schedule = parameters.schedule
    events, clips, kinds = [], [], Counter[str]()
    for row in sample.table().to_pylist():
        scene, trace = read_scene(row["scene"]), read_trace(simulated, row["clip"])
        areas = event_areas(scene, trace, schedule)
        found = find_events(trace, scene.shapes, areas, schedule.frame_steps, parameters.thresholds)
        clips.append({"clip": row["clip"], "think": think_text(scene, found, schedule.seconds)})
        for e in found:
            second = -1 if e.second is None else e.second
            events.append({"clip": row["clip"], "time": e.time, "kind": e.kind, "first": e.first, "second": second})
            kinds[e.kind] += 1
    tables = {"clips": table_from_rows(clips, CLIP_SCHEMA), "events": table_from_rows(events, EVENT_SCHEMA)}
    return ShardResult(tables, notes=dict(kinds))


def main(suite: str) -> None:
    params = load("events", suite)
    thresholds = Thresholds(**params.events.model_dump(), visible_px=params.sample.filters.visible_px)
    parameters = Parameters(params.clip.schedule, thresholds)
    run_shards("events", suite, compute, parameters, ["sample", "simulate"], versions=["numba"])


if __name__ == "__main__":
    run(main)
