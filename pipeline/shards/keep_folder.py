"""One result that cannot be cut into shards (a trained model), kept in the store by the same kind of key.

DVC runs a stage again when any file of its `deps` changed; this one then finds that neither code, parameters
nor inputs differ in substance, and takes the folder from the store.
"""

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pipeline.shards.content_hash import hash_value
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.keys import common_parts
from pipeline.shards.output_errors import writing_to
from pipeline.shards.placement import place
from pipeline.shards.store import Store, StoredShard, default_store

Parameters = TypeVar("Parameters")
Make = Callable[[Path, Path, Sequence[ShardedDataset], Parameters], Mapping[str, int | float]]


def keep_folder(
    stage: str,
    output_dir: Path | str,
    make: Make[Parameters],
    *,
    parameters: Parameters,
    inputs: Sequence[Path | str] = (),
    files: Mapping[str, Path] | None = None,
    versions: Sequence[str] = (),
    store: Store | None = None,
) -> None:
    """Make a folder, or take it from the store, and put it at `output_dir`, replacing what is there.

    Prints one line of outcome.

    Args:
        stage: The stage's name.
        output_dir: The folder to write.
        make: A function of a module: (folder, scratch, inputs, parameters) -> notes. It fills the empty `folder`.
            `scratch` stays when the run is killed, and is there again in the next run of the same key: for checkpoints
            to resume from. The inputs are verified by hash before.
        parameters: A record of all that `make` needs; like the next three in the key, as for `map_shards`.
        inputs: Output folders of other stages.
        files: Named files and folders that `make` reads.
        versions: Names of installed distributions.
        store: Where the folder is kept; None for `default_store()`.

    Raises:
        ShardError: An input is missing or damaged.
        OutputError: The store or the output folder cannot be written to.
    """
    started = time.monotonic()
    output_dir, store = Path(output_dir), store or default_store()
    datasets = [open_shards(folder) for folder in inputs]
    parts = common_parts(make, parameters, versions, files or {})
    names = [f"{dataset.manifest.stage}/{dataset.manifest.suite}" for dataset in datasets]
    contents = [hash_value([entry.content for entry in dataset.manifest.shards]) for dataset in datasets]
    parts = {**parts, "stage": stage, "inputs": [list(pair) for pair in zip(names, contents, strict=True)]}
    key = hash_value(parts)
    stored = store.lookup(key)
    source = "from the store"
    if stored is None:
        source = "computed"
        store.check_writable()
        for dataset in datasets:
            dataset.verify()
        stored = _make(store, key, make, datasets, parameters, parts)
    _put(stored, output_dir)
    notes = "; " * bool(stored.notes) + ", ".join(f"{name} {value:g}" for name, value in stored.notes.items())
    print(f"{stage}: {source}, {time.monotonic() - started:.1f} s{notes}", flush=True)


def _make(
    store: Store,
    key: str,
    make: Make[Any],
    datasets: Sequence[ShardedDataset],
    parameters: object,
    parts: Mapping[str, Any],
) -> StoredShard:
    notes: dict[str, int | float] = {}
    with writing_to(store.folder):
        scratch = store.scratch(key)
    stored = store.commit(key, lambda folder: notes.update(make(folder, scratch, datasets, parameters)), notes, parts)
    shutil.rmtree(scratch, ignore_errors=True)
    return stored


def _put(stored: StoredShard, output_dir: Path) -> None:
    temporary = output_dir.absolute().parent / f".{output_dir.name}.partial"
    with writing_to(output_dir):
        temporary.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(temporary, ignore_errors=True)
        try:
            for name in stored.files:
                (temporary / name).parent.mkdir(parents=True, exist_ok=True)
                place(stored.folder / name, temporary / name)
            if output_dir.exists():
                shutil.rmtree(output_dir)
            temporary.rename(output_dir)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
