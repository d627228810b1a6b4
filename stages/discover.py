"""Discover what each hidden world's known scene lacks. It cannot see the truth: data/hide/truth is no input.

Reads data/hide/measured. Writes data/discover/measured: clip (the world's number), report (JSON, docs/formats.md),
scene (YAML with the effects found). Parameters: seed, discover. Run: python -m stages.discover
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.discrepancy.discover import discover, report
from pipeline.discrepancy.known_scene import known_scene
from pipeline.discrepancy.testable import names_of
from pipeline.discrepancy.track import Track
from pipeline.errors import ParamsError
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


def tracks_of(rows: Sequence[Mapping[str, Any]]) -> list[Track]:
    grouped: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        grouped.setdefault((row["recording"], row["object"]), []).append(row)

    def columns(group: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray | None:
        if any(group[0][n] is None for n in names):
            return None
        return np.array([[row[n] for n in names] for row in group], float)

    out = []
    for (clip, body), group in grouped.items():
        position = columns(group, ("x", "y", "z"))
        assert position is not None
        time = np.array([row["time"] for row in group])
        quaternion, spin = columns(group, ("qw", "qx", "qy", "qz")), columns(group, ("wx", "wy", "wz"))
        out.append(Track(clip, body, time, position, quaternion, spin))
    return out


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (hidden,) = inputs
    rows = []
    for number in shard.clips:
        known = known_scene(YAML(typ="safe").load(hidden.row(number)["scene"]), f"world {number}")
        rng = clip_rng(parameters.seed, "discover", number, "held out")
        found = discover(tracks_of(hidden.rows(number, "tracks")), known, parameters.held_out, parameters.effects, rng)
        rows.append({"clip": number, "report": json.dumps(report(found)), "scene": write_scene(found.scene)})
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main() -> None:
    params = load("discover")
    try:
        effects = names_of(params.discover.effects)
    except ValueError as error:
        raise ParamsError(f"discover.effects: {error}") from None
    parameters = Parameters(params.seed, params.discover.held_out, effects)
    run_shards("discover", "measured", compute, parameters, ["hide"], versions=["mujoco", "numba", "numpy", "scipy"])


if __name__ == "__main__":
    run(main)
