"""Discover what each filmed world's known scene lacks, from its pixels. It cannot see the truth.

The network for masks finds the bodies of each recording; tracks and camera come from these masks. Reads
data/hide/filmed. Writes data/discover/filmed: clip (the world's number), report (JSON, docs/formats.md), scene (YAML
with the effects found), fault (why nothing could be measured; then report and scene are missing).
Parameters: seed, discover. Run: python -m stages.discover_filmed
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.bodies.mask_source import WEIGHTS
from pipeline.discovery.selection.testable import names_of
from pipeline.errors import MeasurementError
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema({"clip": pa.int64(), "report": pa.string(), "scene": pa.string(), "fault": pa.string()})


@dataclass(frozen=True)
class Parameters:
    """held_out: share of a world's clips that is not fitted; effects: those that may be named."""

    seed: int
    held_out: float
    effects: tuple[str, ...]


def found_in(
    number: int, frames: np.ndarray, times: np.ndarray, known: dict[str, Any], p: Parameters
) -> dict[str, Any]:
    """Report and scene of a world.

    Args:
        number: Of the world.
        frames: (C, T, H, W, 3) uint8 of its recordings.
        times: (T,) s.
        known: The content of its scene file.
        p: Parameters of the stage.

    Raises:
        MeasurementError: Where no body can be measured in them.
    """
    # imported here: it takes seconds, and mostly the shards are in the store
    from pipeline.bodies.found_bodies import moving_masks
    from pipeline.bodies.user_clip import mask_networks
    from pipeline.discovery.discover import discover
    from pipeline.discovery.filmed.measured_motion import measure_motion
    from pipeline.discovery.filmed.recorded_clip import RecordedClip
    from pipeline.discovery.filmed.shown_effects import discover_shown
    from pipeline.discovery.report.discovery import Discovery
    from pipeline.discovery.tracks.known_scene import known_scene
    from pipeline.scene.text import write_scene

    networks = mask_networks()
    clips = [RecordedClip(f"clip_{k}", own, moving_masks(own, times, networks), times) for k, own in enumerate(frames)]
    clips = [clip for clip in clips if clip.masks.any()]
    if not clips:
        raise MeasurementError("no body is found in any recording")
    motion = measure_motion(clips, known_scene(known))

    def find(names: Sequence[str]) -> Discovery:  # with the same recordings held out each time
        rng = clip_rng(p.seed, "discover", number, "held out")
        return discover(motion.tracks, motion.known, p.held_out, names, rng)

    shown = discover_shown(motion, p.effects, find)
    return {"report": json.dumps(shown.report), "scene": write_scene(shown.found.scene), "fault": None}


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (hidden,) = inputs
    rows = []
    for number in shard.clips:
        row, frames = hidden.row(number), hidden.array(number, "rgb")
        known, times = YAML(typ="safe").load(row["scene"]), np.arange(frames.shape[1]) / row["fps"]
        try:
            found = found_in(number, frames, times, known, parameters)
        except MeasurementError as error:
            found = {"report": None, "scene": None, "fault": str(error)}
        rows.append({"clip": number} | found)
    faults = sum(row["fault"] is not None for row in rows)
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes={"not measured": faults})


def main() -> None:
    params = load("discover_filmed")
    effects = names_of(params.discover.effects, "discover.effects")
    parameters = Parameters(params.seed, params.discover.held_out, effects)
    run_shards(
        "discover",
        "filmed",
        compute,
        parameters,
        ["hide"],
        files={"masks": WEIGHTS},
        versions=["mujoco", "numba", "numpy", "scipy", "opencv-python-headless", "torch"],
    )


if __name__ == "__main__":
    run(main)
