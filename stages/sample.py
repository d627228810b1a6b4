"""Sample scenes: draw candidates until each clip has one that passes the filters.

Reads nothing but parameters. Writes data/sample/<suite>: clip, composition, scene (YAML).
Parameters: seed, sample, clip, suites.<suite>. Run: python -m stages.sample SUITE
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from pipeline.clips.draw import Filters, draw_clips
from pipeline.clips.schedule import Schedule
from pipeline.scene.sample import Distribution
from pipeline.scene.text import write_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards

SCHEMA = pa.schema({"clip": pa.int64(), "composition": pa.string(), "scene": pa.string()})


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    drawn = draw_clips(
        p["seed"],
        shard.suite,
        shard.clips,
        Distribution(**p["distribution"]),
        Filters(**p["filters"]),
        Schedule(**p["clip"]),
        {int(count): weight for count, weight in p["objects"].items()},
        p["only"],
        p["without"],
    )
    for name in drawn.bad:
        print(f"sample: {name}: the numbers went bad, replaced by the next candidate", flush=True)
    rows = [{"clip": clip, "composition": scene.composition, "scene": write_scene(scene)}
            for clip, scene in zip(shard.clips, drawn.scenes, strict=True)]  # fmt: skip
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=dict(drawn.outcome))


def main(suite: str) -> None:
    params = load("sample", suite)
    own = getattr(params.suites, suite)
    parameters = {
        "seed": params.seed,
        "clip": params.clip.model_dump(),
        "distribution": params.sample.distribution.model_dump(),
        "filters": params.sample.filters.model_dump(),
        "objects": {str(count): weight for count, weight in own.objects.items()},
        "only": own.only,
        "without": own.without,
    }
    run_shards("sample", suite, compute, parameters, clips=own.clips, shard_size=params.sample.shard_size,
               versions=["mujoco", "numba"])  # fmt: skip


if __name__ == "__main__":
    run(main)
