"""Prediction: fit the first part of each clip, and foretell the masks of the rest.

Reads data/render/<suite> (masks), data/flow/<suite>. Writes data/predict/<suite>: clip, scene (found from the first
part alone, from the classical guess: the model has seen the whole clip), iou over the frames that were not seen, of
the scene, of the last masks moved as it moves, of masks that move on at constant velocity, and of masks that stay; and
the scene's over those seen.
Parameters: seed, clip, search.width, search.height, predict. Run: python -m stages.predict SUITE
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa
from tqdm import tqdm

from pipeline.clips.replay import HEIGHT, WIDTH
from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError
from pipeline.evaluation.prediction import predict
from pipeline.scene.text import write_scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.solve import solve
from pipeline.search.target import make_target, resize_masks
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards

SCORES = ("search", "carried", "velocity", "frozen", "seen")
SCHEMA = pa.schema({"clip": pa.int64(), "scene": pa.string(), **dict.fromkeys(SCORES, pa.float64()),
                    "simulations": pa.int32()})  # fmt: skip


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    rendered, flow = inputs
    whole = Schedule(**p["clip"])
    part = whole.first(p["seconds"])
    pairs = part.model_frames
    rows = []
    for clip in tqdm(shard.clips, desc=str(shard), unit="clip", disable=None, leave=False):
        masks = rendered.array(clip, "mask")
        target = make_target(masks[part.pairs[:, 0]], flow.array(clip, "flow")[:pairs], p["width"], p["height"])
        rng = clip_rng(p["seed"], shard.suite, clip, "predict")
        found = solve(Evaluator(target, part, threads=1), [], p["simulations"], rng).found
        said = predict(found.scene, resize_masks(masks, WIDTH, HEIGHT), part.frames, whole)
        rows.append({"clip": clip, "scene": write_scene(found.scene), **{k: getattr(said, k) for k in SCORES},
                     "simulations": found.simulations})  # fmt: skip
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main(suite: str) -> None:
    params = load("predict", suite)
    try:
        Schedule(**params.clip.model_dump()).first(params.predict.seconds)
    except ValueError as error:
        raise ParamsError(f"predict.seconds: {error}") from None
    parameters = {"seed": params.seed, "clip": params.clip.model_dump(), "width": params.search.width,
                  "height": params.search.height, **params.predict.model_dump()}  # fmt: skip
    run_shards("predict", suite, compute, parameters, ["render", "flow"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
