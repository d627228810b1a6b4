"""Film worlds in which an effect is hidden that a camera can see, and the truth, which no discovery stage can see.

Reads nothing but parameters. Writes data/hide/filmed: table clips (clip: the world's number, scene: YAML of what is
known, without a camera, fps), array rgb (C, T, H, W, 3) of a world's C recordings; and data/hide/truth_filmed: clips
(clip, truth: JSON). Parameters: seed, hide_filmed. Run: python -m stages.hide_filmed
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.errors import ParamsError
from pipeline.hidden.filmed_world import FPS, NOTHING, FilmedWorld, make_filmed_world
from pipeline.hidden.world_tables import scene_text, truth_table
from pipeline.scene.effects.registry import effect_kinds
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

WORLDS = pa.schema({"clip": pa.int64(), "scene": pa.string(), "fps": pa.int64()})


@dataclass(frozen=True)
class Parameters:
    """What a world depends on, beside its number.

    Attributes:
        seed: Of all random numbers.
        experiments: The scenario and what is hidden in it, in turn.
        strength: In detection limits of positions with 2 mm of noise.
        clips: Recordings of a world.
    """

    seed: int
    experiments: tuple[tuple[str, str], ...]
    strength: float
    clips: int


def world_of(number: int, p: Parameters) -> tuple[FilmedWorld, np.random.Generator]:
    """A world, and what draws its sensor's errors."""
    rng = clip_rng(p.seed, "hide", number, "filmed world")
    scenario, effect = p.experiments[number % len(p.experiments)]
    return make_filmed_world(effect, scenario, p.strength, p.clips, rng), rng


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    scenes, frames = [], []
    for number in shard.clips:
        world, rng = world_of(number, parameters)
        scenes.append({"clip": number, "scene": scene_text(world.known), "fps": FPS})
        frames.append(np.stack([clip.frames for clip in world.clips(rng, "raycast")]))
    return ShardResult({"clips": table_from_rows(scenes, WORLDS)}, {"rgb": np.stack(frames)})


def compute_truth(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    worlds = {number: world_of(number, parameters)[0] for number in shard.clips}
    return ShardResult({"clips": truth_table({number: world.truth for number, world in worlds.items()})})


def main() -> None:
    params = load("hide_filmed")
    own, valid = params.hide_filmed, (NOTHING, *effect_kinds())
    for place, experiment in enumerate(own.experiments):
        if experiment.effect not in valid:
            raise ParamsError(
                f"hide_filmed.experiments[{place}].effect is {experiment.effect}; valid: {', '.join(valid)}"
            )
    experiments = tuple((e.scenario, e.effect) for e in own.experiments)
    parameters = Parameters(params.seed, experiments, own.strength, own.clips)
    for suite, function in (("filmed", compute), ("truth_filmed", compute_truth)):
        run_shards(
            "hide", suite, function, parameters, clips=own.worlds, shard_size=1, versions=["mujoco", "numba", "numpy"]
        )


if __name__ == "__main__":
    run(main)
