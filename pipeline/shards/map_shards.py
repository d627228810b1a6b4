"""Computing a stage's shards: those that the store has not, then the output folder with its manifest."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from pipeline.errors import ShardError
from pipeline.shards.arrays import write_arrays
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.executor import make_executor
from pipeline.shards.keys import common_parts, shard_key
from pipeline.shards.manifest import ARRAYS, Manifest, notes_text
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.output_folder import FilledShard, check_replaceable, write_output
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.shared_files import file_key, place_file, share_file
from pipeline.shards.store import SECONDS, Store, StoredShard, default_store
from pipeline.shards.tables import write_table

Parameters = TypeVar("Parameters")
Compute = Callable[[Shard, Sequence[OpenShard], Parameters], ShardResult]


@dataclass(frozen=True, kw_only=True)
class _Task:
    """One shard to compute, as it travels to a worker.

    Attributes:
        shard: Its stage, suite and clips.
        key: Its key in the store.
        inputs: Views of its clips in the inputs.
        input_hashes: By input, the content hash of the whole shard that has these clips.
        compute: The stage's function.
        parameters: The stage's record of parameters.
        parts: What the keys of all shards of the run have in common.
        store: Where the shard goes, and where inputs come from on a machine without them.
        files: By path, the key under which the store has it for such a machine.
    """

    shard: Shard
    key: str
    inputs: tuple[OpenShard, ...]
    input_hashes: Mapping[str, str]
    compute: Compute[Any]
    parameters: Any
    parts: Mapping[str, Any]
    store: Store
    files: Mapping[str, str]

    def __str__(self) -> str:
        return str(self.shard)


def map_shards(
    stage: str,
    suite: str,
    output_dir: Path | str,
    compute: Compute[Parameters],
    *,
    parameters: Parameters,
    clips: int | None = None,
    shard_size: int | None = None,
    inputs: Sequence[Path | str] = (),
    files: Mapping[str, Path] | None = None,
    versions: Sequence[str] = (),
    executor: str = "local",
    workers: int | None = None,
    threads: int = 1,
    store: Store | None = None,
) -> Manifest:
    """Compute a stage's shards, or take them from the store, and write them with their manifest to `output_dir`.

    Prints one line of outcome.

    Args:
        stage: The stage's name.
        suite: The suite's name.
        output_dir: The folder to write; what an earlier run left in it is replaced.
        compute: A pure function of a module: (shard, its input shards, parameters) -> ShardResult. Its result for a
            clip must depend on that clip alone, so that it is the same whatever the shard size.
        parameters: A picklable record of all that `compute` needs; `keys.plain` of it is in the key.
        clips: How many clips; may be left out where there are inputs (all of theirs).
        shard_size: Shard k has the clips k·shard_size to (k+1)·shard_size - 1. May be left out where there are inputs
            (their own shards), or be smaller than theirs where it divides it.
        inputs: Output folders of other stages; `compute` gets views of the shard's clips, checked by hash.
        files: Named files and folders (checkpoints) that `compute` reads. Their content is in the key, their path only
            where `parameters` has it.
        versions: Names of installed distributions whose versions are in the key.
        executor: The name of the executor; like `workers` and `threads` in no key.
        workers: Worker processes; None for one a core.
        threads: Numeric threads per worker.
        store: Where the shards are kept; None for `default_store()`.

    Returns:
        The manifest of the output folder.

    Raises:
        ShardError: Inputs are missing, damaged, or cut into other shards.
        OutputError: The store or the output folder cannot be written to.
    """
    started = time.monotonic()
    output_dir = Path(output_dir)
    store = store or default_store()
    datasets = [open_shards(folder) for folder in inputs]
    shards = _cut(stage, suite, clips, shard_size, datasets)
    common = common_parts(compute, parameters, versions, files or {})
    chosen = make_executor(executor, workers, threads)
    shared = {str(path): file_key(path) for path in (files or {}).values()} if chosen.distant else {}
    tasks = []
    for shard in shards:
        views, hashes = _input_views(shard, datasets)
        tasks.append(
            _Task(
                shard=shard,
                key=shard_key(shard, hashes, common),
                inputs=views,
                input_hashes=hashes,
                compute=compute,
                parameters=parameters,
                parts=common,
                store=store,
                files=shared,
            )
        )

    check_replaceable(output_dir)
    with store.using([task.key for task in tasks]):
        stored = {task.key: found for task in tasks if (found := store.lookup(task.key)) is not None}
        missing = [task for task in tasks if task.key not in stored]
        if missing:
            store.check_writable()
            for path, key in shared.items():
                share_file(store, Path(path), key)
        label = f"{stage} {suite}"
        with tqdm(total=len(tasks), initial=len(stored), desc=label, unit="shard", disable=None) as progress:
            for done in chosen.map(_compute_task, missing):
                stored[done.key] = _found(store, done.key) if chosen.distant else done
                progress.update()
        filled = [FilledShard(task.shard, task.input_hashes, stored[task.key]) for task in tasks]
        manifest = write_output(output_dir, stage, suite, filled, common)
    print(
        f"{stage} {suite}: {_plural(len(tasks), 'shard')}, {len(missing)} computed, {len(tasks) - len(missing)} from "
        f"the store, {_plural(manifest.clips, 'clip')}, {time.monotonic() - started:.1f} s{notes_text(manifest.notes)}",
        flush=True,
    )
    return manifest


def _cut(
    stage: str, suite: str, clips: int | None, shard_size: int | None, datasets: Sequence[ShardedDataset]
) -> list[Shard]:
    """The shards of a run. Raises ShardError where the inputs' clips or boundaries do not allow it."""
    available = min((len(dataset) for dataset in datasets), default=None)
    if clips is None:
        if available is None:
            raise TypeError("give `clips` where there are no inputs")
        if any(len(dataset) != available for dataset in datasets):
            counts = ", ".join(f"{dataset.folder} has {len(dataset)}" for dataset in datasets)
            raise ShardError(f"{stage} {suite}: the inputs have different numbers of clips: {counts}; run `dvc repro`")
        clips = available
    if available is not None and clips > available:
        names = ", ".join(str(dataset.folder) for dataset in datasets)
        raise ShardError(f"{stage} {suite}: {clips} clips are wanted, the inputs ({names}) have {available}")
    if shard_size is None:
        if not datasets:
            raise TypeError("give `shard_size` where there are no inputs")
        starts = [shard.start for shard in datasets[0].shards if shard.start < clips]
    else:
        starts = list(range(0, clips, shard_size))
    stops = [*starts[1:], clips] if starts else []
    shards = [Shard(stage, suite, start, stop) for start, stop in zip(starts, stops, strict=True)]
    for shard in shards:
        for dataset in datasets:
            if shard.stop > dataset[shard.start].shard.stop:
                raise ShardError(
                    f"{shard}: these clips are in more than one shard of {dataset.folder} ({_size(dataset)} clips a "
                    f"shard); a stage's shards must each lie in one shard of every input. The inputs: "
                    + ", ".join(f"{other.folder} ({_size(other)} a shard)" for other in datasets)
                    + "; give them one shard_size, or this stage one that divides theirs"
                )
    return shards


def _input_views(shard: Shard, datasets: Sequence[ShardedDataset]) -> tuple[tuple[OpenShard, ...], dict[str, str]]:
    """The shard's clips of every input, and by input the content hash of the whole shard that has them."""
    whole = [dataset[shard.start].shard for dataset in datasets]
    names = [f"{dataset.manifest.stage}/{dataset.manifest.suite}" for dataset in datasets]
    hashes = {name: part.entry.content for name, part in zip(names, whole, strict=True)}
    assert len(hashes) == len(whole), f"{shard}: an input is given twice"
    return tuple(part.narrowed(shard.start, shard.stop) for part in whole), hashes


def _compute_task(task: _Task) -> StoredShard:
    """Compute one shard and commit it to the store; runs in a worker."""
    store = task.store.here()
    with store.using([task.key, *task.files.values(), *(opened.entry.key for opened in task.inputs)]):
        for path, key in task.files.items():
            place_file(store, Path(path), key)
        inputs = [_located(opened, store) for opened in task.inputs]
        for opened in inputs:
            opened.verify()  # else damaged input would be kept under the key of sound input
        return _computed(task, inputs, store)


def _located(opened: OpenShard, store: Store) -> OpenShard:
    """The shard in data/, or on a machine without it in the store."""
    if opened.folder.is_dir():
        return opened
    return opened.in_store(_found(store, opened.entry.key).folder)


def _found(store: Store, key: str) -> StoredShard:
    found = store.lookup(key)
    if found is None:
        raise ShardError(
            f"{store.place} has no shard {key}: machines that share work need one store (DYNAMICS_STORE=s3://…, or a "
            "folder that all of them have)"
        )
    return found


def _computed(task: _Task, inputs: Sequence[OpenShard], store: Store) -> StoredShard:
    began = time.monotonic()
    result = task.compute(task.shard, inputs, task.parameters)
    seconds = round(time.monotonic() - began, 3)
    result.check(task.shard)

    def write(folder: Path) -> Mapping[str, int | float]:
        for name, table in result.tables.items():
            write_table(table, folder / f"{name}.parquet")
        if result.arrays:
            write_arrays(result.arrays, folder / ARRAYS)
        return result.notes

    return store.commit(task.key, write, {**task.parts, "shard": str(task.shard), SECONDS: seconds})


def _size(dataset: ShardedDataset) -> int:
    return max((len(shard) for shard in dataset.shards), default=0)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
