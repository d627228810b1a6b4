"""A place that machines share: shards as objects of S3 or of another file system that fsspec knows.

`<prefix>/<key[:2]>/<key>/<sha256>` are a shard's files, by their hashes, so that no writer changes what another has
written; `shard.json` beside them makes the shard visible. It is written last, and only where it is absent.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import DynamicsError, OutputError, ParamsError, ShardError
from pipeline.shards.checksum import checked_fields
from pipeline.shards.content_hash import hash_file

RECORD = "shard.json"
PATIENCE_S = 120.0  # so long a server may be gone
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 10.0
_ANSWERS = (FileNotFoundError, FileExistsError, PermissionError)  # of a server that is there

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Remote:
    """url: as s3://bucket/prefix."""

    url: str

    def record(self, key: str) -> dict[str, Any] | None:
        """The record of a shard; None where there is no such shard, or its record is damaged."""
        try:
            record: dict[str, Any] = json.loads(self._patiently(lambda: self._fs.cat_file(self._path(key, RECORD))))
            return record if checked_fields(record)["key"] == key else None
        except (FileNotFoundError, ValueError):
            return None

    def fetch(self, record: Mapping[str, Any], folder: Path) -> bool:
        """Bring the files of a shard with this record into an empty folder; gives whether all of them are whole."""
        for name, digest in record["files"].items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            source = self._path(record["key"], digest)
            try:
                self._patiently(partial(self._fs.get_file, source, str(path)))
            except FileNotFoundError:
                return False
            if hash_file(path) != digest:
                return False
        return True

    def publish(self, key: str, folder: Path, record: Mapping[str, Any]) -> None:
        """Add the shard in `folder`.

        Raises:
            ShardError: The key has other bytes there.
            OutputError: The place cannot be written to.
        """
        try:
            for name, digest in record["files"].items():
                source, target = str(folder / name), self._path(key, digest)
                self._patiently(partial(self._fs.put_file, source, target))
            self._make_visible(key, record)
        except (FileNotFoundError, PermissionError) as error:
            raise OutputError(f"cannot write to {self.url}: {error}") from error

    def _make_visible(self, key: str, record: Mapping[str, Any]) -> None:
        text = (json.dumps(record, indent=1, sort_keys=True) + "\n").encode()
        target = self._path(key, RECORD)
        try:
            self._patiently(lambda: self._fs.pipe_file(target, text, mode="create"))
        except FileExistsError:
            there = self.record(key)
            if there is None:  # damaged
                self._patiently(lambda: self._fs.pipe_file(target, text))
            elif there["files"] != record["files"] or there["notes"] != record["notes"]:
                raise ShardError(
                    f"{self.url} has another result for {key}: the stage is not deterministic, or machines of two "
                    "kinds share the store and give different last digits; the first result stays"
                ) from None

    def _patiently(self, ask: Callable[[], Answer]) -> Answer:
        """What `ask` gives, asked again while the server cannot be reached. Raises OutputError when patience ends."""
        until, pause = time.monotonic() + PATIENCE_S, _FIRST_PAUSE_S
        while True:
            try:
                return ask()
            except (DynamicsError, *_ANSWERS):
                raise
            except Exception as error:  # botocore's errors have no base with OSError
                if "PreconditionFailed" in str(error) or "At least one of the pre-conditions" in str(error):
                    raise FileExistsError(str(error)) from None
                if time.monotonic() > until:
                    raise OutputError(f"{self.url} could not be reached for {PATIENCE_S:g} s: {error}") from error
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_S)

    @property
    def _fs(self) -> Any:
        return _file_system(self.url)[0]

    def _path(self, key: str, name: str) -> str:
        return f"{_file_system(self.url)[1]}/{key[:2]}/{key}/{name}"


@cache
def _file_system(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    try:
        import fsspec

        system, path = fsspec.core.url_to_fs(url, use_listings_cache=False)
    except ImportError as error:
        raise ParamsError(f'{url} needs another package ({error}): pip install -e ".[s3]"') from None
    except ValueError as error:
        raise ParamsError(
            f"{url} is no place for a store ({error}); valid: a folder, file://…, s3://bucket/…"
        ) from None
    return system, path.rstrip("/")
