"""What the store takes, and the removal of what was not used for the longest time; safe beside runs.

A stage that needs a removed shard computes it again.
"""

import time
from dataclasses import dataclass
from pathlib import Path

from pipeline.shards.store import Store

_DAY_S = 24 * 3600.0


@dataclass(frozen=True)
class Usage:
    """How many shards, and the bytes of these, of scratch folders and of temporary files."""

    shards: int
    shard_bytes: int
    scratch_bytes: int
    temporary_bytes: int

    @property
    def bytes(self) -> int:
        return self.shard_bytes + self.scratch_bytes + self.temporary_bytes


def usage(store: Store) -> Usage:
    sizes = [_size_bytes(path) for path in store.shards()]
    scratch = sum(_size_bytes(path) for path in store.scratches())
    return Usage(len(sizes), sum(sizes), scratch, _size_bytes(store.temporary))


def prune(store: Store, *, keep_days: float | None = None, keep_bytes: int | None = None) -> Usage:
    """Remove what was last used more than `keep_days` ago, then the oldest until `keep_bytes` are left in all.

    Temporary files of processes that have ended go first. What a run uses stays, even beyond the limit. Returns what
    was removed. Raises OutputError.
    """
    before = usage(store)
    store.sweep()
    now = time.time()
    with store.pruning() as used:
        left = usage(store).bytes
        oldest_first = sorted((last_use(path), path) for path in (*store.shards(), *store.scratches()))
        for used_at, path in oldest_first:
            too_old = keep_days is not None and now - used_at > keep_days * _DAY_S
            too_large = keep_bytes is not None and left > keep_bytes
            if (too_old or too_large) and path.name not in used:
                size = _size_bytes(path)
                if store.discard_unused(path):
                    left -= size
    after = usage(store)
    return Usage(
        before.shards - after.shards,
        before.shard_bytes - after.shard_bytes,
        before.scratch_bytes - after.scratch_bytes,
        before.temporary_bytes - after.temporary_bytes,
    )


def last_use(folder: Path) -> float:
    """Of a shard (its folder's time) or of scratch (its newest file's), s since 1970."""
    try:
        if len(folder.parent.name) == 2:
            return folder.stat().st_mtime
        return max(path.stat().st_mtime for path in (folder, *folder.rglob("*")))
    except FileNotFoundError:  # another process has removed it
        return 0.0


def _size_bytes(folder: Path) -> int:
    total = 0
    for path in folder.rglob("*"):
        try:
            state = path.stat()
        except FileNotFoundError:
            continue
        total += state.st_size if path.is_file() else 0
    return total
