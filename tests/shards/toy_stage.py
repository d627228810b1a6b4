"""Two small stages, one after the other, for the tests; as a program, the first one in a process of its own."""

import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.errors import SimulationError
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.manifest import Manifest
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.store import Store
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run

BALLS = pa.schema([("clip", pa.int64()), ("mass", pa.float64()), ("tags", pa.list_(pa.string()))])
EVENTS = pa.schema([("clip", pa.int64()), ("time", pa.float32())])


@dataclass(frozen=True)
class Drop:
    """seed: of the balls; then, flag: what `drop_until_shard_2` does, and a file that it makes."""

    seed: int
    then: str = ""
    flag: str = ""


def drop(shard: Shard, inputs: Sequence[OpenShard], parameters: Drop) -> ShardResult:
    """Balls with masks (4 x 8 x 8), depths (a different number of rows a clip) and 0 to 2 events."""
    balls, events, masks, depths = [], [], [], []
    for clip in shard.clips:
        rng = clip_rng(parameters.seed, shard.suite, clip, "drop")
        balls.append({"clip": clip, "mass": rng.uniform(), "tags": ["a"] * int(rng.integers(3))})
        masks.append(rng.integers(0, 4, (4, 8, 8), dtype=np.uint8))
        depths.append(rng.normal(size=(clip % 4, 3)).astype(np.float32))
        events += [{"clip": clip, "time": rng.uniform()} for _ in range(clip % 3)]
    tables = {"clips": table_from_rows(balls, BALLS), "events": table_from_rows(events, EVENTS)}
    return ShardResult(tables, {"mask": np.stack(masks), "depth": depths}, {"rejected": 2 * len(shard)})


def weigh(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """The mass of each ball and the number of pixels of its mask, from `drop`."""
    (dropped,) = inputs
    assert dropped.clips == shard.clips
    masses = {row["clip"]: row["mass"] for row in dropped.table().to_pylist()}
    rows = [{"clip": clip, "time": masses[clip] + dropped.array(clip, "mask").sum()} for clip in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, EVENTS)})


def drop_until_shard_2(shard: Shard, inputs: Sequence[OpenShard], parameters: Drop) -> ShardResult:
    """As `drop`, but clip 8 and later do what `parameters.then` says."""
    if shard.start >= 8:
        match parameters.then:
            case "raise":
                raise SimulationError("ball_0 left the universe")
            case "die":
                os.kill(os.getpid(), signal.SIGKILL)
            case "wait":
                Path(parameters.flag).touch()
                time.sleep(600)
    return drop(shard, inputs, parameters)


def make(root: Path, clips: int = 20, shard_size: int = 4, workers: int = 1, seed: int = 1, **more: Any) -> Manifest:
    """Run `drop` into root/drop/train with root/store as the store."""
    return map_shards(
        "drop",
        "train",
        root / "drop" / "train",
        more.pop("compute", drop),
        parameters=Drop(seed, **more.pop("extra", {})),
        clips=clips,
        shard_size=shard_size,
        workers=workers,
        store=Store(root / "store"),
        **more,
    )


def make_weights(root: Path, workers: int = 1, **more: Any) -> Manifest:
    """Run `weigh` on what `make` left."""
    return map_shards(
        "weigh",
        "train",
        root / "weigh" / "train",
        weigh,
        parameters=None,
        inputs=[root / "drop" / "train"],
        workers=workers,
        store=Store(root / "store"),
        **more,
    )


def main(root: str, then: str) -> None:
    extra = {"then": then, "flag": f"{root}/flag"}
    make(Path(root), workers=2, compute=drop_until_shard_2, extra=extra)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    run(main)
