"""What the store takes, and the removal of what was not used for the longest time; safe beside runs.

A stage that needs a removed shard computes it again.
"""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import ParamsError
from pipeline.shards.store import Store

LIMIT_ENVIRONMENT = "DYNAMICS_STORE_GIB"
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


def store_limit() -> int | None:
    """Bytes that $DYNAMICS_STORE_GIB allows; None without it. Raises ParamsError where it is no size."""
    text = os.environ.get(LIMIT_ENVIRONMENT, "")
    if not text:
        return None
    try:
        gib = float(text)
    except ValueError:
        gib = -1.0
    if not 0 < gib < 2**30:
        raise ParamsError(f"{LIMIT_ENVIRONMENT} is {text!r}; valid: a number of GiB greater than 0")
    return int(gib * 2**30)


def last_use(folder: Path) -> float:
    """Of a shard (its folder's time) or of scratch (its newest file's), s since 1970."""
    whole = len(folder.parent.name) == 2
    return max((state.st_mtime for state in _states([folder] if whole else [folder, *_files(folder)])), default=0.0)


def _size_bytes(folder: Path) -> int:
    return sum(state.st_size for state in _states(_files(folder)))


def _files(folder: Path) -> Iterator[Path]:
    """The files of a folder, of which other processes may remove some meanwhile."""
    for place, _, names in os.walk(folder):
        yield from (Path(place, name) for name in names)


def _states(paths: Iterable[Path]) -> Iterator[os.stat_result]:
    for path in paths:
        with suppress(OSError):
            yield path.stat()
