"""CMA-ES from the best samples: types fixed, everything else free and bounded.

Reads data/best_of_k/<suite>, data/render/<suite> (masks), data/flow/<suite>. Writes data/cmaes/<suite>: clip, scene,
reward, iou, simulations, spent and history (best reward after so many simulations). Parameters: seed, clip, search,
cmaes. Run: python -m stages.cmaes SUITE
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa
from tqdm import tqdm

from pipeline.clips.schedule import Schedule
from pipeline.search.cmaes import Budget, cmaes_search
from pipeline.search.evaluator import Evaluator
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.found_row import FOUND, found_row
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards
from stages.graph.search_target import distinct_starts, search_target

SCHEMA = pa.schema([("clip", pa.int64()), *FOUND])


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    ranked, rendered, flow = inputs
    rows, invalid = [], 0
    for clip in tqdm(shard.clips, desc=str(shard), unit="clip", disable=None, leave=False):
        starts = distinct_starts(ranked, clip, p["starts"])
        evaluator = Evaluator(search_target(rendered, flow, clip, p), Schedule(**p["clip"]), threads=1)
        found = cmaes_search(evaluator, starts, Budget(p["population"], p["iterations"], p["sigma"]),
                       clip_rng(p["seed"], shard.suite, clip, "cmaes"))  # fmt: skip
        rows.append({"clip": clip, **found_row(found)})
        invalid += found.invalid
    notes = {"simulations": sum(row["simulations"] for row in rows), "invalid": invalid}
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=notes)


def main(suite: str) -> None:
    params = load("cmaes", suite)
    parameters = {"seed": params.seed, "clip": params.clip.model_dump(), **params.search.model_dump(),
                  **params.cmaes.model_dump()}  # fmt: skip
    run_shards("cmaes", suite, compute, parameters, ["best_of_k", "render", "flow"],
               versions=["mujoco", "numba", "cma"])  # fmt: skip


if __name__ == "__main__":
    run(main)
