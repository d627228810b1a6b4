"""CMA-ES from the best samples: types fixed, everything else free and bounded.

Reads data/best_of_k/<suite>, data/render/<suite> (masks), data/flow/<suite>. Writes data/cmaes/<suite>: clip, scene,
reward, iou, simulations, spent and history (best reward after so many simulations). Parameters: seed, clip, search,
cmaes. Run: python -m stages.cmaes SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.search.cmaes import Budget, cmaes_search
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.found_row import FOUND, found_row
from stages.graph.params import SearchSettings
from stages.graph.run import run, run_shards
from stages.graph.search_target import ranked_starts, shard_evaluator
from stages.graph.stage_params import load

SCHEMA = pa.schema([("clip", pa.int64()), *FOUND])


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        seed: Of the search.
        schedule: The frames of a clip.
        search: The size at which a search compares, and from how many samples it starts.
        budget: Of CMA-ES.
    """

    seed: int
    schedule: Schedule
    search: SearchSettings
    budget: Budget


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    ranked, rendered, flow = inputs
    rows, invalid = [], 0
    for clip in tqdm(shard.clips, desc=str(shard), unit="clip", disable=None, leave=False):
        starts = ranked_starts(ranked, clip, parameters.search.starts)
        evaluator = shard_evaluator(rendered, flow, clip, parameters.schedule, parameters.search.size)
        rng = clip_rng(parameters.seed, shard.suite, clip, "cmaes")
        found = cmaes_search(evaluator, starts, parameters.budget, rng)
        rows.append({"clip": clip, **found_row(found)})
        invalid += found.invalid
    notes = {"simulations": sum(row["simulations"] for row in rows), "invalid": invalid}
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=notes)


def main(suite: str) -> None:
    params = load("cmaes", suite)
    parameters = Parameters(params.seed, params.clip.schedule, params.search, Budget(**params.cmaes.model_dump()))
    inputs = ["best_of_k", "render", "flow"]
    run_shards("cmaes", suite, compute, parameters, inputs, versions=["mujoco", "numba", "cma"])


if __name__ == "__main__":
    run(main)
