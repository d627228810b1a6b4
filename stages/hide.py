"""Hide effects in worlds: measurements for the discovery, and the truth, which no discovery stage can see.

Reads nothing but parameters. Writes data/hide/measured: tables clips (clip: the world's number, scene: YAML of what is
known) and tracks (a row for each sample; `recording` is the clip of the measured format); and data/hide/truth: clips
(clip, truth: JSON). Parameters: seed, hide. Run: python -m stages.hide
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.discovery.tracks.track import ROW_NUMBERS, track_rows
from pipeline.hidden.recipe import recipe_of
from pipeline.hidden.world import World, make_world
from pipeline.hidden.world_tables import scene_text, truth_table
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

WORLDS = pa.schema({"clip": pa.int64(), "scene": pa.string()})
TRACKS = pa.schema(
    {"clip": pa.int64(), "recording": pa.string(), "object": pa.string()} | {name: pa.float64() for name in ROW_NUMBERS}
)


@dataclass(frozen=True)
class Parameters:
    """What a world depends on, beside its number.

    Attributes:
        seed: Of all random numbers.
        effects: What is hidden, in turn.
        strength: In detection limits.
        noise: Standard deviation of the measured positions, m.
        clips: Recordings of a world.
    """

    seed: int
    effects: tuple[str, ...]
    strength: float
    noise: float
    clips: int


def world_of(number: int, p: Parameters) -> World:
    rng = clip_rng(p.seed, "hide", number, "world")
    return make_world(recipe_of(number, p.effects, p.strength, p.noise, p.clips, rng=rng), rng)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    scenes, rows = [], []
    for number in shard.clips:
        world = world_of(number, parameters)
        scenes.append({"clip": number, "scene": scene_text(world.known)})
        rows += [row | {"clip": number, "recording": row["clip"]} for row in track_rows(world.tracks)]
    tables = {"clips": table_from_rows(scenes, WORLDS), "tracks": table_from_rows(rows, TRACKS)}
    return ShardResult(tables, notes={"samples": len(rows)})


def compute_truth(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    return ShardResult({"clips": truth_table({number: world_of(number, parameters).truth for number in shard.clips})})


def main() -> None:
    params = load("hide")
    own = params.hide
    parameters = Parameters(params.seed, tuple(own.effects), own.strength, own.noise, own.clips)
    for suite, function in (("measured", compute), ("truth", compute_truth)):
        run_shards(
            "hide", suite, function, parameters, clips=own.worlds, shard_size=2, versions=["mujoco", "numba", "numpy"]
        )


if __name__ == "__main__":
    run(main)
