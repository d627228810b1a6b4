"""Simulate clips at 240 steps a second: states and contacts.

Reads data/compile/<suite>. Writes data/simulate/<suite>: arrays position, quaternion, velocity, angular_velocity,
(objects, steps + 1, 3 or 4) a clip; table contacts, a row per contact point and step.
Parameters: clip. Run: python -m stages.simulate SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.physics.simulate import compile_xml, simulate_model
from pipeline.physics.trace_shards import contact_table, trace_arrays
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load


@dataclass(frozen=True)
class Parameters:
    schedule: Schedule


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (compiled,) = inputs
    traces = []
    for row in compiled.table().to_pylist():
        try:
            traces.append(simulate_model(compile_xml(row["xml"]), parameters.schedule.seconds))
        except SimulationError as error:
            raise SimulationError(
                f"{shard.suite}/{row['clip']}: {error}; sample.filters should have left it out"
            ) from None
    contacts: pa.Table = pa.concat_tables([contact_table(c, t) for c, t in zip(shard.clips, traces, strict=True)])
    return ShardResult({"contacts": contacts}, trace_arrays(traces), {"contacts": len(contacts)})


def main(suite: str) -> None:
    params = load("simulate", suite)
    run_shards("simulate", suite, compute, Parameters(params.clip.schedule), ["compile"], versions=["mujoco"])


if __name__ == "__main__":
    run(main)
