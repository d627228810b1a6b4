"""Forecast: fit the first part of each clip, and forecast the masks of the rest.

Reads data/render/<suite> (masks), data/flow/<suite>. Writes data/predict/<suite>: clip, scene (found from the first
part and the classical guess: the model has seen the whole clip), simulations, and sequence IoU: over the unseen frames
search (the scene's replay), moved_with_replay, constant_velocity, frozen; over the seen ones seen (the scene's replay).
Parameters: seed, clip, search.width, search.height, predict. Run: python -m stages.predict SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
from tqdm import tqdm

from pipeline.clips.replay import HEIGHT, WIDTH
from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError
from pipeline.report.prediction import forecast_scores
from pipeline.scene.text import write_scene
from pipeline.search.search_scene import search_scene
from pipeline.search.target import resize_masks
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.search_target import shard_evaluator
from stages.graph.stage_params import load

SCORES = ("search", "moved_with_replay", "constant_velocity", "frozen", "seen")
SCHEMA = pa.schema(
    {"clip": pa.int64(), "scene": pa.string(), **dict.fromkeys(SCORES, pa.float64()), "simulations": pa.int32()}
)


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        seed: Of the search.
        schedule: The frames of a clip.
        part: The frames of its first part, which the search sees.
        size: Width and height at which the search compares, px.
        simulations: How many a clip's search may run.
    """

    seed: int
    schedule: Schedule
    part: Schedule
    size: tuple[int, int]
    simulations: int


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    rendered, flow = inputs
    whole, part = parameters.schedule, parameters.part
    rows = []
    for clip in tqdm(shard.clips, desc=str(shard), unit="clip", disable=None, leave=False):
        masks = rendered.array(clip, "mask")
        evaluator = shard_evaluator(rendered, flow, clip, part, parameters.size)
        rng = clip_rng(parameters.seed, shard.suite, clip, "predict")
        found = search_scene(evaluator, [], parameters.simulations, rng).result
        scores = forecast_scores(found.scene, resize_masks(masks, WIDTH, HEIGHT), part.frames, whole)
        rows.append(
            {
                "clip": clip,
                "scene": write_scene(found.scene),
                **{k: getattr(scores, k) for k in SCORES},
                "simulations": found.simulations,
            }
        )
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main(suite: str) -> None:
    params = load("predict", suite)
    schedule = params.clip.schedule
    try:
        part = schedule.first(params.predict.seconds)
    except ValueError as error:
        raise ParamsError(f"predict.seconds: {error}") from None
    parameters = Parameters(
        seed=params.seed,
        schedule=schedule,
        part=part,
        size=(params.search.width, params.search.height),
        simulations=params.predict.simulations,
    )
    run_shards("predict", suite, compute, parameters, ["render", "flow"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
