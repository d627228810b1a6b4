"""Sample scenes: draw candidates until each clip has one that passes the filters.

Reads nothing but parameters. Writes data/sample/<suite>: clip, composition, scene (YAML). The suite `views` has its own
kinds of scenes (`pipeline.scene.sample_views`).
Parameters: seed, sample, clip, suites.<suite>. Run: python -m stages.sample SUITE
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.clips.draw import Drawn, Filters, draw_clips
from pipeline.clips.draw_views import draw_view_clips
from pipeline.clips.schedule import Schedule
from pipeline.scene.sample import Distribution
from pipeline.scene.text import write_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.params import ViewsSuiteSettings
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema({"clip": pa.int64(), "composition": pa.string(), "scene": pa.string()})


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        seed: Of all random numbers.
        schedule: The frames of a clip.
        distribution: What the candidates are drawn from.
        filters: Which candidates are accepted.
        objects: Number of objects -> weight.
        only: Compositions to draw from instead, as box+box+sphere.
        without: Compositions that are never drawn.
    """

    seed: int
    schedule: Schedule
    distribution: Distribution
    filters: Filters
    objects: Mapping[int, float]
    only: Sequence[str]
    without: Sequence[str]


@dataclass(frozen=True)
class ViewParameters:
    """What `compute` needs for the suite `views`: the seed of all random numbers, and the frames of a clip."""

    seed: int
    schedule: Schedule


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters | ViewParameters) -> ShardResult:
    drawn = _draw(shard, parameters)
    for name in drawn.bad:
        print(f"sample: {name}: the numbers went bad, replaced by the next candidate", flush=True)
    rows = [
        {"clip": clip, "composition": scene.composition, "scene": write_scene(scene)}
        for clip, scene in zip(shard.clips, drawn.scenes, strict=True)
    ]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=dict(drawn.outcome))


def _draw(shard: Shard, parameters: Parameters | ViewParameters) -> Drawn:
    if isinstance(parameters, ViewParameters):
        return draw_view_clips(parameters.seed, shard.suite, shard.clips, parameters.schedule)
    return draw_clips(
        parameters.seed,
        shard.suite,
        shard.clips,
        parameters.distribution,
        parameters.filters,
        parameters.schedule,
        parameters.objects,
        parameters.only,
        parameters.without,
    )


def main(suite: str) -> None:
    params = load("sample", suite)
    own = getattr(params.suites, suite)
    parameters: Parameters | ViewParameters = ViewParameters(params.seed, params.clip.schedule)
    if not isinstance(own, ViewsSuiteSettings):
        parameters = Parameters(
            seed=params.seed,
            schedule=params.clip.schedule,
            distribution=Distribution(**params.sample.distribution.model_dump()),
            filters=Filters(**params.sample.filters.model_dump()),
            objects=own.objects,
            only=own.only,
            without=own.without,
        )
    run_shards(
        "sample",
        suite,
        compute,
        parameters,
        clips=own.clips,
        shard_size=params.sample.shard_size,
        versions=["mujoco", "numba"],
    )


if __name__ == "__main__":
    run(main)
