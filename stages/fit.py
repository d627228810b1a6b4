"""The search of choice: Gauss-Newton and jumps from the best samples and a classical guess.

Reads data/best_of_k/<suite>, data/render/<suite> (masks), data/flow/<suite>. Writes data/fit/<suite>: clip, guess (the
classical guess, a scene) and guess_simulations, scene, reward, iou, simulations, spent and history (best reward after
so many simulations), instance (which one each object is, from 0; -1: none), certainty (how far the clip determines each
number).
Parameters: seed, clip, search, fit. Run: python -m stages.fit SUITE
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import pyarrow as pa
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.inference.scene_search import search_clip
from pipeline.scene.text import write_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.found_row import FOUND, found_row
from stages.graph.params import SearchSettings
from stages.graph.run import run, run_shards
from stages.graph.search_target import ranked_starts, shard_evaluator
from stages.graph.stage_params import load

CERTAINTY = pa.struct(
    {
        "place": pa.string(),
        "kind": pa.string(),
        "value": pa.float64(),
        "spread": pa.float64(),
        "unit": pa.string(),
        "share": pa.float64(),
    }
)
SCHEMA = pa.schema(
    [
        ("clip", pa.int64()),
        ("guess", pa.string()),
        ("guess_simulations", pa.int32()),
        *FOUND,
        ("instance", pa.list_(pa.int32())),
        ("certainty", pa.list_(CERTAINTY)),
    ]
)


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        seed: Of the search.
        schedule: The frames of a clip.
        search: The size at which a search compares, and from how many samples it starts.
        simulations: How many a clip's search may run.
    """

    seed: int
    schedule: Schedule
    search: SearchSettings
    simulations: int


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    ranked, rendered, flow = inputs
    rows, invalid = [], 0
    for clip in tqdm(shard.clips, desc=str(shard), unit="clip", disable=None, leave=False):
        evaluator = shard_evaluator(rendered, flow, clip, parameters.schedule, parameters.search.size)
        starts = ranked_starts(ranked, clip, parameters.search.starts)
        rng = clip_rng(parameters.seed, shard.suite, clip, "fit")
        searched = search_clip(evaluator, starts, parameters.simulations, rng)
        instance = dict(searched.pairs.tolist())
        rows.append(
            {
                "clip": clip,
                "guess": None if searched.guess is None else write_scene(searched.guess),
                "guess_simulations": searched.guess_simulations,
                **found_row(searched.result),
                "instance": [instance.get(i, -1) for i in range(len(searched.result.scene.objects))],
                "certainty": [asdict(c) for c in searched.certainties],
            }
        )
        invalid += searched.result.invalid
    notes = {"simulations": sum(row["simulations"] for row in rows), "invalid": invalid}
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=notes)


def main(suite: str) -> None:
    params = load("fit", suite)
    parameters = Parameters(params.seed, params.clip.schedule, params.search, params.fit.simulations)
    run_shards("fit", suite, compute, parameters, ["best_of_k", "render", "flow"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
