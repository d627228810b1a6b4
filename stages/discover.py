"""Discover what each hidden world's known scene lacks. It cannot see the truth: data/hide/truth is no input.

Reads data/hide/measured. Writes data/discover/measured: clip (the world's number), report (JSON, docs/formats.md),
scene (YAML with the effects found). Parameters: seed, discover. Run: python -m stages.discover
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.discovery.discover import discover
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.selection.testable import names_of
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.track import tracks_from_rows
from pipeline.scene.text import write_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema({"clip": pa.int64(), "report": pa.string(), "scene": pa.string()})


@dataclass(frozen=True)
class Parameters:
    """held_out: share of a world's clips that is not fitted; effects: those that may be named."""

    seed: int
    held_out: float
    effects: tuple[str, ...]


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (hidden,) = inputs
    rows = []
    for number in shard.clips:
        known = known_scene(YAML(typ="safe").load(hidden.row(number)["scene"]), f"world {number}")
        rng = clip_rng(parameters.seed, "discover", number, "held out")
        tracks = tracks_from_rows(row | {"clip": row["recording"]} for row in hidden.rows(number, "tracks"))
        found = discover(tracks, known, parameters.held_out, parameters.effects, rng)
        rows.append({"clip": number, "report": json.dumps(report_dict(found)), "scene": write_scene(found.scene)})
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main() -> None:
    params = load("discover")
    effects = names_of(params.discover.effects, "discover.effects")
    parameters = Parameters(params.seed, params.discover.held_out, effects)
    run_shards("discover", "measured", compute, parameters, ["hide"], versions=["mujoco", "numba", "numpy", "scipy"])


if __name__ == "__main__":
    run(main)
