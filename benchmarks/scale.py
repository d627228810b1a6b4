"""What shards, tasks and stages cost, for the plan in docs/scaling.md.

    python -m benchmarks.scale stages [--data data]   seconds and bytes a clip of each stage, of the last `make repro`
    python -m benchmarks.scale overhead [--ray]       seconds a shard costs beside its work, by executor and workers
    python -m benchmarks.scale starts                 seconds of stages whose shards are all in the store
    python -m benchmarks.scale memory                 peak memory of the process that runs a stage, by clips
    python -m benchmarks.scale score [--data data]    the same for what `score` holds of a suite

`stages` reads what the store kept of the run; nothing is computed. `starts` runs the stages of dvc.lock again, each for
one suite, and takes the least of three times. `overhead` and `memory` run a stage of this module
on data that it makes: arrays of the size of a training clip's exact flow. `score` repeats the answers of the suite `id`
of the last `make repro`, and sums them up as the stage does, without their replays: a replay takes one clip and is gone
before the next.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from ruamel.yaml import YAML

from pipeline.errors import ShardError
from pipeline.report.markdown import markdown
from pipeline.shards.dataset import open_shards
from pipeline.shards.manifest import MANIFEST
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.remote import RECORD
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.store import Store, default_store
from pipeline.shards.tables import table_from_rows

SCORED = ("sample", "infer", "best_of_k", "cmaes", "fit")
FLOW = (10, 160, 240, 2)  # of a training clip, float16: 1.5 MB before compression
SCHEMA = pa.schema({"clip": pa.int64(), "checksum": pa.float64()})


@dataclass(frozen=True)
class Work:
    """arrays: whether the result of a clip has flow."""

    arrays: bool


def work(shard: Shard, inputs: Sequence[OpenShard], parameters: Work) -> ShardResult:
    """A row, with smooth flow of the size of a training clip's where asked."""
    rows = [{"clip": clip, "checksum": float(clip)} for clip in shard.clips]
    arrays = {}
    if parameters.arrays:
        ramp = np.linspace(0, 1, FLOW[2], dtype=np.float16)[None, None, :, None]
        arrays["flow"] = [np.broadcast_to(ramp * (clip % 7), FLOW).copy() for clip in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, arrays)


def read(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """The sum of each clip's flow: what a stage that reads arrays does."""
    rows = [
        {"clip": clip, "checksum": float(inputs[0].array(clip, "flow").sum(dtype=np.float32))} for clip in shard.clips
    ]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def stages(data: Path) -> list[dict[str, object]]:
    """One row a stage: clips, seconds of one core and bytes a clip, files a shard."""
    totals: dict[str, list[float]] = defaultdict(lambda: [0, 0, 0, 0, 0])
    store = default_store()
    for manifest in sorted(data.glob("*/*/manifest.json")):
        try:
            dataset = open_shards(manifest.parent)
        except ShardError:
            continue
        seconds = dataset.compute_seconds(store)
        if seconds is None or not len(dataset):
            continue
        files = [manifest.parent / name for shard in dataset.shards for name in shard.entry.files]
        own = (len(dataset), seconds, sum(file.stat().st_size for file in files), len(files), len(dataset.shards))
        totals[dataset.manifest.stage] = [a + b for a, b in zip(totals[dataset.manifest.stage], own, strict=True)]
    return [
        {
            "stage": name,
            "clips": int(clips),
            "seconds_a_clip": round(seconds / clips, 4),
            "kib_a_clip": round(size / clips / 1024, 1),
            "files_a_shard": round(files / shards, 1),
        }
        for name, (clips, seconds, size, files, shards) in totals.items()
    ]


def starts(lock: Path, times: int = 3) -> list[dict[str, object]]:
    """Least seconds by the clock and of processors of each stage in shards, run for its first suite in `lock`.

    Raises SystemExit where a shard is not in the store.
    """
    commands: dict[str, str] = {}
    for name, entry in YAML(typ="safe").load(lock)["stages"].items():
        if any((Path(out["path"]) / MANIFEST).is_file() for out in entry.get("outs", [])):
            commands.setdefault(name.partition("@")[0], entry["cmd"])
    rows: list[dict[str, object]] = []
    for name, command in commands.items():
        spent = [_spent([sys.executable, *command.split()[1:]]) for _ in range(times)]
        clock, processor = (min(seconds) for seconds in zip(*spent, strict=True))
        rows.append({"stage": name, "seconds": round(clock, 2), "processor_seconds": round(processor, 2)})
        print(rows[-1], flush=True)
    return rows


def _spent(command: Sequence[str]) -> tuple[float, float]:
    """Seconds by the clock and of processors of a stage that computes nothing."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    clock, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if " 0 computed" not in said:
        raise SystemExit(f"{' '.join(command)} computed shards; run `make repro` first")
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def overhead(executors: Sequence[str], shards: int = 128) -> list[dict[str, object]]:
    """Seconds to the first shard, and seconds that each further shard takes one worker beside its work, by executor
    and workers. Of the latter the least over 16 shards in a row, which other work on the machine disturbs least."""
    rows: list[dict[str, object]] = []
    for executor in executors:
        for workers in (1, 2):
            stored = _seconds_to_shards(executor, workers, shards)
            a_shard = workers * float(np.min(stored[16:] - stored[:-16])) / 16
            start = {"executor": executor, "workers": workers, "start_s": round(float(stored[0]), 2)}
            rows.append({**start, "seconds_a_shard": round(a_shard, 4)})
    return rows


def _seconds_to_shards(executor: str, workers: int, shards: int) -> np.ndarray:
    """(shards,) s after which one shard after the other was in the store, of a stage without work."""
    with tempfile.TemporaryDirectory() as folder:
        store, began = Store(Path(folder) / "store"), time.time()
        map_shards(
            "work",
            "toy",
            Path(folder) / "out",
            work,
            parameters=Work(arrays=False),
            clips=shards,
            shard_size=1,
            executor=executor,
            workers=workers,
            store=store,
        )
        records = store.folder.rglob(RECORD)
        return np.sort([record.stat().st_mtime for record in records]) - began


def memory(counts: Sequence[int], shard_size: int) -> list[dict[str, object]]:
    """Peak memory of two stages, each in a process of its own, by clips."""
    rows: list[dict[str, object]] = []
    for clips in counts:
        with tempfile.TemporaryDirectory() as folder:
            for stage in ("write", "read"):
                command = [
                    sys.executable,
                    "-m",
                    "benchmarks.scale",
                    "measure",
                    stage,
                    folder,
                    str(clips),
                    str(shard_size),
                ]
                said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
                rows.append({"clips": clips, "shards": -(-clips // shard_size), "stage": stage, **json.loads(said)})
                print(rows[-1], flush=True)
    return rows


def measure(stage: str, folder: Path, clips: int, shard_size: int) -> None:
    """Run one stage and print the peak memory of this process."""
    store = Store(folder / "store")
    if stage == "score":
        sum_up(folder)
    elif stage == "write":
        work_, cut = Work(arrays=True), {"clips": clips, "shard_size": shard_size}
        map_shards("write", "toy", folder / "write", work, parameters=work_, workers=1, store=store, **cut)
    else:
        inputs = [folder / "write"]
        map_shards("read", "toy", folder / "read", read, parameters=None, inputs=inputs, workers=1, store=store)
        open_shards(folder / "write").verify()
    print(json.dumps({"peak_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)}))


@dataclass(frozen=True)
class Source:
    """folder: the output of a stage whose rows are repeated."""

    folder: str


def repeated(shard: Shard, inputs: Sequence[OpenShard], parameters: Source) -> ShardResult:
    """The rows of a suite, over and over, under new numbers of clips."""
    source = open_shards(parameters.folder)
    whole, parts = source.table(), []
    first = whole.column("clip").to_numpy()
    for clip in shard.clips:
        begin, end = np.searchsorted(first, (clip % len(source), clip % len(source) + 1))
        rows = whole.slice(begin, end - begin)
        parts.append(rows.set_column(rows.column_names.index("clip"), "clip", pa.array([clip] * len(rows), pa.int64())))
    return ShardResult({"clips": pa.concat_tables(parts).combine_chunks()})


def score_memory(data: Path, counts: Sequence[int], shard_size: int) -> list[dict[str, object]]:
    """Peak memory of summing up a suite, in a process of its own, by clips."""
    rows: list[dict[str, object]] = []
    for clips in counts:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for stage in SCORED:
                map_shards(
                    stage,
                    "id",
                    folder / stage,
                    repeated,
                    parameters=Source(str(data / stage / "id")),
                    clips=clips,
                    shard_size=shard_size,
                    workers=1,
                    store=Store(folder / "store"),
                )
            command = [sys.executable, "-m", "benchmarks.scale", "measure", "score", name, str(clips), str(shard_size)]
            said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[-1]
            rows.append({"clips": clips, **json.loads(said)})
            print(rows[-1], flush=True)
    return rows


def sum_up(folder: Path) -> None:
    """What `stages.score` does with a suite, with one set of scores for all answers in place of their replays."""
    from pipeline.report.determined import spreads_by_kind
    from pipeline.report.scene_scores import METRICS
    from pipeline.report.suite import AnsweredSuite
    from pipeline.report.summary import summarise
    from pipeline.report.tables import ERRORS
    from stages.score import written

    scores = {name: 0.123456 * k for k, name in enumerate((*METRICS, *ERRORS))}
    suite = AnsweredSuite("id", {stage: open_shards(folder / stage) for stage in SCORED})
    rows = ({**head, **scores} for _, answers in suite.answered() for head, _ in answers)
    summarise(written(rows, folder / "clips.csv"), list(scores), 100, np.random.default_rng(1))
    suite.best_of_k_rows()
    suite.search_rows()
    spreads_by_kind(suite.certainties())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("stages", "overhead", "starts", "memory", "score", "measure"))
    parser.add_argument("own", nargs="*", help=argparse.SUPPRESS)
    parser.add_argument("--data", type=Path, default=Path("data"))
    parser.add_argument("--ray", action="store_true", help="overhead: with Ray, too")
    parser.add_argument("--clips", type=int, nargs="+", default=[1000, 4000, 16000], help="memory, score: how many")
    parser.add_argument("--shard-size", type=int, default=64, help="memory: clips a shard")
    arguments = parser.parse_args()
    match arguments.what:
        case "measure":
            stage, folder, clips, shard_size = arguments.own
            measure(stage, Path(folder), int(clips), int(shard_size))
            return
        case "stages":
            rows = stages(arguments.data)
        case "overhead":
            rows = overhead(["local", *["ray"] * arguments.ray])
        case "starts":
            rows = starts(Path("dvc.lock"))
        case "score":
            rows = score_memory(arguments.data, arguments.clips, arguments.shard_size)
        case _:
            rows = memory(arguments.clips, arguments.shard_size)
    print(markdown(list(rows[0]), [list(map(str, row.values())) for row in rows]), end="")


if __name__ == "__main__":
    main()
