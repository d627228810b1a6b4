"""Remove old shards from the store: `python -m pipeline.shards.prune --keep-days 30` or `--keep-gib 50`.

The shards that were last used the longest time ago are removed first. A stage that needs one computes it again.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import DynamicsError
from pipeline.shards.store import Store, default_store

_DAY_S = 24 * 3600.0
_GIB = 2**30


@dataclass(frozen=True)
class Pruned:
    """How much was removed and how much is left."""

    removed: int
    removed_bytes: int
    kept: int
    kept_bytes: int


def prune(store: Store, *, keep_days: float | None = None, keep_bytes: int | None = None) -> Pruned:
    """Remove shards last used more than `keep_days` ago, then the oldest until `keep_bytes` are left."""
    now = time.time()
    newest_first = sorted(((path.stat().st_mtime, path) for path in store.shards()), reverse=True)
    removed = removed_bytes = kept = kept_bytes = 0
    for used, path in newest_first:
        size = _size_bytes(path)
        too_old = keep_days is not None and now - used > keep_days * _DAY_S
        too_large = keep_bytes is not None and kept_bytes + size > keep_bytes
        if too_old or too_large:
            store.discard(path)
            removed, removed_bytes = removed + 1, removed_bytes + size
        else:
            kept, kept_bytes = kept + 1, kept_bytes + size
    for path in store.scratches():
        if keep_days is not None and now - _last_written(path) > keep_days * _DAY_S:
            store.discard(path)
    return Pruned(removed, removed_bytes, kept, kept_bytes)


def _last_written(folder: Path) -> float:
    return max(path.stat().st_mtime for path in (folder, *folder.rglob("*")))


def _size_bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m pipeline.shards.prune", description=__doc__)
    parser.add_argument("--keep-days", type=float, help="keep what was used in the last days")
    parser.add_argument("--keep-gib", type=float, help="keep at most so much, the last used first")
    parser.add_argument("--store", type=Path, help="the store (default: $DYNAMICS_STORE, else .shards)")
    options = parser.parse_args(arguments)
    if options.keep_days is None and options.keep_gib is None:
        parser.error("give --keep-days or --keep-gib")
    store = Store(options.store) if options.store else default_store()
    keep_bytes = None if options.keep_gib is None else int(options.keep_gib * _GIB)
    try:
        result = prune(store, keep_days=options.keep_days, keep_bytes=keep_bytes)
    except DynamicsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(
        f"{store.folder}: {result.removed} shards removed ({result.removed_bytes / _GIB:.2f} GiB), "
        f"{result.kept} kept ({result.kept_bytes / _GIB:.2f} GiB)"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
