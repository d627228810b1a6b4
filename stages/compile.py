"""Compile scenes to MJCF and have MuJoCo's compiler check them.

Reads data/sample/<suite>. Writes data/compile/<suite>: clip, xml. Run: python -m stages.compile SUITE
"""

from collections.abc import Sequence

import pyarrow as pa

from pipeline.physics.simulate import compile_xml
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.text import read_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards

SCHEMA = pa.schema({"clip": pa.int64(), "xml": pa.string()})


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    (sample,) = inputs
    rows = []
    for row in sample.table().to_pylist():
        xml = scene_xml(read_scene(row["scene"], f"{shard.suite}/{row['clip']}"))
        compile_xml(xml)
        rows.append({"clip": row["clip"], "xml": xml})
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main(suite: str) -> None:
    run_shards("compile", suite, compute, None, ["sample"], versions=["mujoco", "dm-control"])


if __name__ == "__main__":
    run(main)
