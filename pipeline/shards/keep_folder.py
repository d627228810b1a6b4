"""One result that cannot be cut into shards (a trained model), kept in the store by the same kind of key.

DVC runs a stage again when a byte of its `deps` changed. Where that changed neither code, nor parameters, nor inputs,
the folder is taken from the store. The output has the folder's files and `contents.json` with their hashes.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from pipeline.shards.content_hash import hash_value
from pipeline.shards.contents import write_contents
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.keys import common_parts
from pipeline.shards.manifest import notes_text
from pipeline.shards.output_errors import writing_to
from pipeline.shards.output_folder import place, replacing
from pipeline.shards.store import Store, default_store

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
    with store.using([key]):
        stored, outcome = store.lookup(key), "from the store"
        if stored is not None:
            store.clear_scratch(key)
        else:
            store.check_writable()
            for dataset in datasets:
                dataset.verify()
            with writing_to(store.folder), store.scratch(key) as scratch:
                stored = store.lookup(key)  # another process may have made it meanwhile
                if stored is None:
                    outcome = "computed"
                    stored = store.commit(key, lambda folder: make(folder, scratch, datasets, parameters), parts)
        with replacing(output_dir) as temporary:
            for name in stored.files:
                place(stored.folder / name, temporary / name)
            write_contents(temporary, key, stored.files)
    print(f"{stage}: {outcome}, {time.monotonic() - started:.1f} s{notes_text(stored.notes)}", flush=True)
