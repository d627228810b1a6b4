"""The content-keyed store of computed shards: `<store>/<key>/` with its files and `shard.json`.

A shard is written to a temporary folder and renamed, so that a shard in the store is complete. Its files are hashed
before it is used, so that a damaged one is noticed, removed and computed again.
"""

import json
import os
import shutil
import socket
import sys
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.shards.content_hash import hash_files, hash_tree, hash_value
from pipeline.shards.output_errors import writing_to

ENVIRONMENT = "DYNAMICS_STORE"
SECONDS = "seconds"
"""The name in a shard's record of how long one worker computed it, s; times are no part of a shard's content."""
_RECORD = "shard.json"
_TEMPORARY = "tmp"
_SCRATCH = "scratch"


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
    """A folder of shards by key, which any number of processes may use at the same time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()

    def lookup(self, key: str, warn: Callable[[str], None] | None = None) -> StoredShard | None:
        """The shard of that key, or None. Every byte is checked; a damaged shard is reported and removed."""
        folder = self._folder_of(key)
        if not folder.is_dir():
            return None
        shard, damage = _read(folder, key)
        if shard is None:
            (warn or _print_warning)(f"{folder} is damaged ({damage}); it is removed and computed again")
            with writing_to(folder):
                self._remove(folder)
            return None
        with suppress(OSError):  # a read-only store can still be read
            os.utime(folder)  # its last use, for prune
        return shard

    def record_of(self, key: str) -> dict[str, Any] | None:
        """The record beside the shard of that key, not checked; None where there is none."""
        try:
            return json.loads((self._folder_of(key) / _RECORD).read_bytes())
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
        """
        with writing_to(self.folder), self._temporary() as temporary:
            notes = dict(sorted(write(temporary).items()))
            files = hash_files(temporary)
            record: dict[str, Any] = {"key": key, "files": files, "notes": notes, "parts": dict(parts)}
            record["checksum"] = hash_value(record)
            (temporary / _RECORD).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")
            _make_durable(temporary)
            target = self._folder_of(key)
            target.parent.mkdir(exist_ok=True)
            try:
                temporary.rename(target)
            except OSError:
                if not target.is_dir():  # else another process was first, with the same bytes
                    raise
            _sync_folder(target.parent)
        return StoredShard(key, target, files, notes)

    def scratch(self, key: str) -> Path:
        """A folder for intermediate results under a key; it stays until it is removed."""
        folder = self.folder / _SCRATCH / key
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def scratches(self) -> Iterator[Path]:
        """The scratch folders of runs that were stopped or still go on."""
        return iter(sorted((self.folder / _SCRATCH).glob("*")))

    def shards(self) -> Iterator[Path]:
        """The folders of all shards."""
        return (path for path in sorted(self.folder.glob("??/*")) if len(path.name) == 64)

    def discard(self, folder: Path) -> None:
        """Remove one shard's folder."""
        with writing_to(folder):
            self._remove(folder)

    def check_writable(self) -> None:
        """Raise OutputError before anything is computed; remove what processes left that were killed."""
        with writing_to(self.folder):
            with self._temporary():
                pass
            self._sweep()

    def _folder_of(self, key: str) -> Path:
        return self.folder / key[:2] / key

    @contextmanager
    def _temporary(self) -> Iterator[Path]:
        path = self.folder / _TEMPORARY / f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex}"
        path.mkdir(parents=True)
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)

    def _remove(self, folder: Path) -> None:
        """It is renamed first, so that no process sees a part of it."""
        with self._temporary() as trash, suppress(FileNotFoundError):  # another process removed it
            folder.rename(trash / folder.name)

    def _sweep(self) -> None:
        for path in (self.folder / _TEMPORARY).iterdir():
            host, _, rest = path.name.rpartition("-")[0].rpartition("-")
            if host == socket.gethostname() and rest.isdigit() and not _is_running(int(rest)):
                shutil.rmtree(path, ignore_errors=True)


def default_store() -> Store:
    """The store of this repository: $DYNAMICS_STORE, else `.shards` beside the nearest dvc.yaml or .git."""
    if place := os.environ.get(ENVIRONMENT):
        return Store(Path(place).expanduser())
    here = Path.cwd()
    roots = (path for path in (here, *here.parents) if (path / "dvc.yaml").exists() or (path / ".git").exists())
    return Store(next(roots, here) / ".shards")


def _read(folder: Path, key: str) -> tuple[StoredShard | None, str]:
    """The shard in `folder`, or what is wrong with it."""
    try:
        record = json.loads((folder / _RECORD).read_bytes())
        checksum = record.pop("checksum")
        if checksum != hash_value(record) or record["key"] != key:
            return None, f"{_RECORD} was changed"
        files = hash_files(folder)
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        return None, f"{_RECORD} cannot be read: {error}"
    del files[_RECORD]
    expected = record["files"]
    for name in sorted(files.keys() | expected.keys()):
        if name not in files:
            return None, f"{name} is missing"
        if name not in expected:
            return None, f"{name} does not belong there"
        if files[name] != expected[name]:
            return None, f"the bytes of {name} are not those that were written"
    return StoredShard(key, folder, files, record["notes"]), ""


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


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _print_warning(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)
