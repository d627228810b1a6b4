"""Hide effects in worlds: measurements for the discovery, and the truth, which no discovery stage can see.

Reads nothing but parameters. Writes data/hide/measured: tables clips (clip: the world's number, scene: YAML of what is
known) and tracks (a row for each sample; `recording` is the clip of the measured format); and data/hide/truth: clips
(clip, truth: JSON). Parameters: seed, hide. Run: python -m stages.hide
"""

import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.discrepancy.tracks.track import ROW_NUMBERS, track_rows
from pipeline.hidden.recipe import recipe_of
from pipeline.hidden.world import World, make_world
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards

WORLDS = pa.schema({"clip": pa.int64(), "scene": pa.string()})
TRUTH = pa.schema({"clip": pa.int64(), "truth": pa.string()})
TRACKS = pa.schema({"clip": pa.int64(), "recording": pa.string(), "object": pa.string()}
                   | {name: pa.float64() for name in ROW_NUMBERS})  # fmt: skip


def world_of(number: int, p: Mapping[str, Any]) -> World:
    rng = clip_rng(p["seed"], "hide", number, "world")
    return make_world(recipe_of(number, p["effects"], p["strength"], p["noise"], p["clips"], rng), rng)


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    scenes, rows = [], []
    for number in shard.clips:
        world = world_of(number, p)
        text = io.StringIO()
        YAML(typ="safe").dump(world.known, text)
        scenes.append({"clip": number, "scene": text.getvalue()})
        rows += [row | {"clip": number, "recording": row["clip"]} for row in track_rows(world.tracks)]
    tables = {"clips": table_from_rows(scenes, WORLDS), "tracks": table_from_rows(rows, TRACKS)}
    return ShardResult(tables, notes={"samples": len(rows)})


def compute_truth(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    rows = [{"clip": n, "truth": json.dumps(world_of(n, p).truth, sort_keys=True)} for n in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, TRUTH)})


def main() -> None:
    params = load("hide")
    own = params.hide
    parameters = {"seed": params.seed, "effects": list(own.effects), "strength": own.strength, "noise": own.noise,
                  "clips": own.clips}  # fmt: skip
    for suite, function in (("measured", compute), ("truth", compute_truth)):
        run_shards(
            "hide", suite, function, parameters, clips=own.worlds, shard_size=2, versions=["mujoco", "numba", "numpy"]
        )


if __name__ == "__main__":
    run(main)
