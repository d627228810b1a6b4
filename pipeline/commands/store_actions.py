"""What `dynamics store` does."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from pipeline.errors import ParamsError
from pipeline.shards.copies import Copies
from pipeline.shards.prune import Usage, prune, usage
from pipeline.shards.store import default_store

_GIB = 2**30


def info(arguments: argparse.Namespace) -> None:
    store = default_store()
    print(f"{store.folder}: {_text(usage(store))}")


def prune_store(arguments: argparse.Namespace) -> None:
    if arguments.keep_days is None and arguments.keep_gib is None:
        raise ParamsError("prune: give --keep-days or --keep-gib")
    store = default_store()
    keep_bytes = None if arguments.keep_gib is None else int(arguments.keep_gib * _GIB)
    removed = prune(store, keep_days=arguments.keep_days, keep_bytes=keep_bytes)
    print(f"{store.folder}: removed {_text(removed)}; kept {_text(usage(store))}")


def fsck(arguments: argparse.Namespace) -> None:
    copies = Copies(arguments.root, default_store())
    mended, removed = copies.mend()
    for path in mended:
        print(f"mended {path}")
    for path in removed:
        print(f"removed {path}: no copy is sound; `make repro` makes it again")
    print(f"{copies.checked} files checked, {len(mended)} mended, {len(removed)} removed")


def link(arguments: argparse.Namespace) -> None:
    linked = Copies(arguments.root, default_store()).link()
    print(f"{linked} files of the store share their bytes with data/ now")


ACTIONS: dict[str, Callable[[argparse.Namespace], None]] = {
    "info": info,
    "prune": prune_store,
    "fsck": fsck,
    "link": link,
}


def _text(used: Usage) -> str:
    return (
        f"{used.shards} shards ({used.shard_bytes / _GIB:.2f} GiB), scratch {used.scratch_bytes / _GIB:.2f} GiB, "
        f"temporary files {used.temporary_bytes / _GIB:.2f} GiB"
    )
