"""The content-keyed store of computed shards: `<store>/<key>/` with its files and `shard.json`.

A shard is written to a temporary folder and renamed, so that a shard in the store is complete. Its files are hashed
before it is used, so that a damaged one is noticed, removed and computed again. With a remote place (`remote.py`) the
folder is a cache of it.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import OutputError, ShardError
from pipeline.shards.checksum import ChecksumError, checked_fields, with_checksum
from pipeline.shards.content_hash import hash_files, hash_tree, hash_value
from pipeline.shards.file_lock import abandoned, claimed, live_claims, locked
from pipeline.shards.output_errors import writing_to
from pipeline.shards.remote import RECORD, Remote

ENVIRONMENT, CACHE_ENVIRONMENT = "DYNAMICS_STORE", "DYNAMICS_CACHE"
SECONDS = "seconds"
"""The name in a shard's record of how long one worker computed it, s; times are no part of a shard's content."""
_TEMPORARY = "tmp"
_SCRATCH = "scratch"
_USES = "uses"
_PUBLISHED = "published"
_PRUNE_LOCK = "prune.lock"


@dataclass(frozen=True)
class StoredShard:
    """A complete shard in the store; files: relative path -> SHA-256."""

    key: str
    folder: Path
    files: Mapping[str, str]
    notes: Mapping[str, int | float]

    @property
    def content(self) -> str:
        """One hash of all its files."""
        return hash_tree(self.files)


class Store:
    """A folder of shards by key, which any number of processes may use at the same time.

    With a remote place, it is the cache of that place on this machine.
    """

    def __init__(self, folder: Path, remote: Remote | None = None) -> None:
        self.folder = folder.absolute()
        self.remote = remote

    @property
    def place(self) -> str:
        """Where the shards are kept, for messages."""
        return self.remote.url if self.remote else str(self.folder)

    def here(self) -> "Store":
        """The same store on this machine, whose cache may be elsewhere."""
        cache = os.environ.get(CACHE_ENVIRONMENT)
        return Store(Path(cache), self.remote) if self.remote and cache else self

    def lookup(self, key: str) -> StoredShard | None:
        """The shard of that key, or None. Every byte is checked; a damaged shard is reported and removed."""
        folder = self.folder_of(key)
        if not folder.is_dir():
            return self._fetched(key)
        shard, damage = read_stored(folder, key)
        if shard is None:
            _print_warning(f"{folder} is damaged ({damage}); it is removed and computed again")
            self.discard(folder)
            return self._fetched(key)
        self._publish(shard)
        with suppress(OSError):  # a read-only store can still be read
            os.utime(folder)  # its last use, for prune
        return shard

    def record_of(self, key: str) -> dict[str, Any] | None:
        """The record beside the shard of that key, not checked; None where there is none."""
        try:
            return json.loads((self.folder_of(key) / RECORD).read_bytes())
        except (OSError, ValueError):
            return None

    def commit(
        self, key: str, write: Callable[[Path], Mapping[str, int | float]], parts: Mapping[str, Any]
    ) -> StoredShard:
        """Add a shard. Nothing stays if that fails.

        Args:
            key: The shard's key.
            write: Fills an empty folder, which becomes the shard, and returns the shard's notes.
            parts: What the key was made of, and what else is to be written beside the shard.

        Returns:
            What `lookup` of the key would give; the notes are in the order of their names.

        Raises:
            OutputError: The store cannot be written to.
            ShardError: The store has other bytes under this key.
        """
        with writing_to(self.folder), self._temporary() as temporary:
            notes = dict(sorted(write(temporary).items()))
            files = hash_files(temporary)
            record = with_checksum({"key": key, "files": files, "notes": notes, "parts": dict(parts)})
            (temporary / RECORD).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")
            shard = self._adopt(temporary, StoredShard(key, self.folder_of(key), files, notes))
        self._publish(shard)
        return shard

    @contextmanager
    def using(self, keys: Iterable[str]) -> Iterator[None]:
        """Shards of these keys are not pruned meanwhile, even where another process prunes."""
        with ExitStack() as stack:
            with suppress(OSError):  # a read-only store: nobody prunes it
                with locked(self.folder / _PRUNE_LOCK, shared=True):
                    (self.folder / _USES).mkdir(exist_ok=True)
                    note = stack.enter_context(claimed(self.folder / _USES))
                    note.write_text("\n".join(keys))
                stack.callback(note.unlink, missing_ok=True)
            yield

    @contextmanager
    def pruning(self) -> Iterator[frozenset[str]]:
        """Gives the keys that runs use. No other run begins meanwhile."""
        with writing_to(self.folder), locked(self.folder / _PRUNE_LOCK):
            for left in abandoned(self.folder / _USES):
                left.unlink(missing_ok=True)
            yield frozenset(key for note in live_claims(self.folder / _USES) for key in _noted_keys(note))

    @contextmanager
    def scratch(self, key: str) -> Iterator[Path]:
        """A folder for intermediate results under a key, for one process at a time; others wait. It stays after an
        error or a kill, and is removed at the end."""
        folder = self.folder / _SCRATCH / key
        with locked(folder.with_suffix(".lock")):
            folder.mkdir(parents=True, exist_ok=True)
            yield folder
            shutil.rmtree(folder, ignore_errors=True)
            folder.with_suffix(".lock").unlink(missing_ok=True)

    def clear_scratch(self, key: str) -> None:
        """Remove the scratch folder of a key, which a kill right after the commit leaves."""
        folder = self.folder / _SCRATCH / key
        if folder.is_dir():
            with suppress(OSError, OutputError):  # a read-only store
                self.discard_unused(folder)

    def scratches(self) -> Iterator[Path]:
        """The scratch folders of runs that were stopped or still go on."""
        return (path for path in sorted((self.folder / _SCRATCH).glob("*")) if path.is_dir())

    def discard_unused(self, folder: Path) -> bool:
        """Remove a shard, or a scratch folder that no process uses; gives whether it was removed."""
        if folder.parent.name != _SCRATCH:
            self.discard(folder)
            return True
        with locked(folder.with_suffix(".lock"), wait=False) as held:
            if held:
                self.discard(folder)
                folder.with_suffix(".lock").unlink(missing_ok=True)
            return held

    @property
    def temporary(self) -> Path:
        """The folder of temporary files."""
        return self.folder / _TEMPORARY

    def shards(self) -> Iterator[Path]:
        """The folders of all shards."""
        return (path for path in sorted(self.folder.glob("??/*")) if len(path.name) == 64)

    def discard(self, folder: Path) -> None:
        """Remove the folder of a shard. It is renamed first, so that no process sees a part of it."""
        with writing_to(folder), self._temporary() as trash, suppress(FileNotFoundError):  # another process removed it
            folder.rename(trash / folder.name)

    def check_writable(self) -> None:
        """Raise OutputError before anything is computed; remove what processes left that were killed."""
        with writing_to(self.folder):
            with self._temporary():
                pass
            self.sweep()

    def sweep(self) -> None:
        """Remove the temporary folders of processes that have ended."""
        for path in abandoned(self.temporary):
            shutil.rmtree(path, ignore_errors=True)

    def folder_of(self, key: str) -> Path:
        return self.folder / key[:2] / key

    def _fetched(self, key: str) -> StoredShard | None:
        """The shard of that key from the remote place, where there is one."""
        record = self.remote.record(key) if self.remote else None
        if self.remote is None or record is None:
            return None
        with writing_to(self.folder), self._temporary() as temporary:
            if not self.remote.fetch(record, temporary):
                _print_warning(f"{self.remote.url} has the shard {key}, but it is damaged; it is computed again")
                return None
            (temporary / RECORD).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")
            shard = self._adopt(temporary, StoredShard(key, self.folder_of(key), record["files"], record["notes"]))
            self._note_published(key)
        return shard

    def _publish(self, shard: StoredShard) -> None:
        """Bring a shard to the remote place, unless that was done before."""
        if self.remote is None or self._published(shard.key).exists():
            return
        record = self.record_of(shard.key)
        assert record is not None, f"{shard.folder} was read before"
        self.remote.publish(shard.key, shard.folder, record)
        with writing_to(self.folder):
            self._note_published(shard.key)

    def _note_published(self, key: str) -> None:
        self._published(key).parent.mkdir(parents=True, exist_ok=True)
        self._published(key).touch()

    def _published(self, key: str) -> Path:
        """A file that says that the remote place has the shard."""
        assert self.remote is not None
        return self.folder / _PUBLISHED / hash_value(self.remote.url)[:16] / key

    @contextmanager
    def _temporary(self) -> Iterator[Path]:
        with claimed(self.temporary) as path:
            path.mkdir()
            try:
                yield path
            finally:
                shutil.rmtree(path, ignore_errors=True)

    def _adopt(self, temporary: Path, shard: StoredShard) -> StoredShard:
        """Make a complete temporary folder the shard. Raises ShardError where the store has other bytes for it."""
        _make_durable(temporary)
        target = shard.folder
        target.parent.mkdir(exist_ok=True)
        while True:
            with suppress(OSError):
                temporary.rename(target)
                break
            if not target.is_dir():
                temporary.rename(target)  # for its error
                break
            there, damage = read_stored(target, shard.key)
            if there is None:
                _print_warning(f"{target} is damaged ({damage}); it is replaced")
                self.discard(target)
                continue
            if there.files != shard.files or there.notes != shard.notes:
                raise ShardError(_other_bytes(there, shard))
            return there
        _sync_folder(target.parent)
        return shard


def default_store() -> Store:
    """The store of this repository: $DYNAMICS_STORE, else `.shards` beside the nearest dvc.yaml or .git.

    $DYNAMICS_STORE is a folder, file://…, or a URL as s3://bucket/prefix; then `.shards`, or $DYNAMICS_CACHE, is its
    cache on this machine.
    """
    place = os.environ.get(ENVIRONMENT, "")
    if place and "://" not in place.removeprefix("file://"):
        return Store(Path(place.removeprefix("file://")).expanduser())
    remote = Remote(place) if place else None
    if remote and (cache := os.environ.get(CACHE_ENVIRONMENT)):
        return Store(Path(cache).expanduser(), remote)
    here = Path.cwd()
    roots = (path for path in (here, *here.parents) if (path / "dvc.yaml").exists() or (path / ".git").exists())
    return Store(next(roots, here) / ".shards", remote)


def read_stored(folder: Path, key: str) -> tuple[StoredShard | None, str]:
    """The shard in `folder`, or what is wrong with it."""
    try:
        record = checked_fields(json.loads((folder / RECORD).read_bytes()))
        if record["key"] != key:
            return None, f"{RECORD} was changed"
        files = hash_files(folder)
    except ChecksumError:
        return None, f"{RECORD} was changed"
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        return None, f"{RECORD} cannot be read: {error}"
    del files[RECORD]
    expected = record["files"]
    for name in sorted(files.keys() | expected.keys()):
        if name not in files:
            return None, f"{name} is missing"
        if name not in expected:
            return None, f"{name} does not belong there"
        if files[name] != expected[name]:
            return None, f"the bytes of {name} are not those that were written"
    return StoredShard(key, folder, files, record["notes"]), ""


def _noted_keys(note: Path) -> list[str]:
    """The keys that a run uses; none where it has just ended."""
    try:
        return note.read_text().split()
    except FileNotFoundError:
        return []


def _make_durable(folder: Path) -> None:
    """Read-only files whose bytes are on the disk."""
    for path in folder.rglob("*"):
        if path.is_file():
            path.chmod(0o444)
            with open(path, "rb") as file:
                os.fsync(file.fileno())
    for path in (folder, *folder.rglob("*")):
        if path.is_dir():
            _sync_folder(path)


def _sync_folder(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _other_bytes(there: StoredShard, shard: StoredShard) -> str:
    names = sorted({*there.files, *shard.files})
    different = [name for name in names if there.files.get(name) != shard.files.get(name)] or ["the notes"]
    return (
        f"{there.folder} was computed a second time with another result ({different[0]}): the stage is not "
        "deterministic, or machines of two kinds share the store and give different last digits; the first result stays"
    )


def _print_warning(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)
