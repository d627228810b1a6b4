"""The copies of an output: in the store, in data/ and in DVC's cache. A damaged one is mended from one that is sound.

data/ and DVC's cache are mostly the same file (hard links), which the store is too after `link`; then no copy is sound
where one is damaged, and the stage has to be run again.
"""

import hashlib
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pipeline.errors import ShardError
from pipeline.shards.contents import CONTENTS, read_contents
from pipeline.shards.manifest import MANIFEST, read_manifest, stored_name
from pipeline.shards.output_errors import writing_to
from pipeline.shards.output_folder import place
from pipeline.shards.store import Store, read_stored

_LOCK, _DATA, _CACHE = "dvc.lock", "data", ".dvc/cache/files/md5"


@dataclass
class SameBytes:
    """Files that must have the same bytes, and the hashes that these must have, as far as they are known.

    Attributes:
        sha256: By the manifest in data/.
        md5: By DVC.
        made: Paths in data/ and in the store, which must be there.
        cached: The path in DVC's cache, which may be missing.
    """

    sha256: str | None = None
    md5: str | None = None
    made: list[Path] = field(default_factory=list)
    cached: Path | None = None

    @property
    def paths(self) -> list[Path]:
        return [*self.made, *([self.cached] if self.cached and self.cached.exists() else [])]

    def is_sound(self, path: Path) -> bool:
        try:
            found = _hashes(path)
        except OSError:
            return False
        return all(mine in (None, theirs) for mine, theirs in zip((self.sha256, self.md5), found, strict=True))


class Copies:
    """The outputs below `root` (the folder of dvc.yaml), with what the store and DVC's cache have of them."""

    def __init__(self, root: Path, store: Store) -> None:
        self.root, self.store, self.cache = root, store, root / _CACHE
        self.checked = 0

    def mend(self) -> tuple[list[Path], list[Path]]:
        """Mend what is damaged. Returns which files were mended, and which were removed for want of a sound copy.

        Raises OutputError where a place cannot be written to.
        """
        mended: list[Path] = []
        removed: list[Path] = []
        with writing_to(self.root):
            for group in self._listings():
                self._mend(group, mended, removed)
            for group in self._groups():
                self._mend(group, mended, removed)
            for folder in self.store.shards():
                if read_stored(folder, folder.name)[0] is None:
                    self.store.discard(folder)
                    removed.append(folder)
        return mended, removed

    def link(self) -> int:
        """Make the store's files hard links to those of data/; returns how many were separate before."""
        linked = 0
        for group in self._groups():
            for path in group.made[1:]:
                first = group.made[0]
                if group.is_sound(first) and group.is_sound(path) and not path.samefile(first):
                    temporary = path.with_name(f".{uuid.uuid4().hex}")
                    os.link(first, temporary)
                    temporary.replace(path)
                    linked += 1
        return linked

    def _mend(self, group: SameBytes, mended: list[Path], removed: list[Path]) -> None:
        self.checked += len(group.paths)
        damaged = [path for path in group.paths if not group.is_sound(path)]
        sound = next((path for path in group.paths if path not in damaged), None)
        for path in damaged:
            if sound is not None:
                temporary = path.with_name(f".{uuid.uuid4().hex}")
                place(sound, temporary)
                temporary.replace(path)
                mended.append(path)
            elif path.exists():
                path.unlink()
                removed.append(path)

    def _listings(self) -> Iterator[SameBytes]:
        """The manifests, by which all else is checked, and DVC's own listings."""
        for path in sorted(self.cache.glob("??/*.dir")):
            yield SameBytes(md5=path.parent.name + path.name.removesuffix(".dir"), cached=path)
        for folder, listed in self._outputs().items():
            for name in (MANIFEST, CONTENTS):
                if name in listed and (folder / name).is_file() and not _is_whole(folder, name):
                    yield SameBytes(md5=listed[name], made=[folder / name], cached=self._cached(listed[name]))

    def _groups(self) -> Iterator[SameBytes]:
        seen: set[Path] = set()
        outputs = self._outputs()
        for record in sorted((self.root / _DATA).rglob("*.json")):
            folder = record.parent
            if record.name not in (MANIFEST, CONTENTS) or not _is_whole(folder, record.name):
                continue
            listed = outputs.get(folder, {})
            if listed.get(record.name) != _hashes(record)[1]:
                listed = {}  # DVC's cache has another version of this output
            for name, (digest, stored) in self._files(folder, record.name).items():
                md5 = listed.get(name)
                group = SameBytes(digest, md5, [folder / name], (md5 and self._cached(md5)) or None)
                if stored.parent.is_dir():
                    group.made.append(stored)
                if group.cached:
                    seen.add(group.cached)
                yield group
        for path in sorted(self.cache.glob("??/*")):
            if path not in seen and path.suffix != ".dir":
                yield SameBytes(md5=path.parent.name + path.name, cached=path)

    def _files(self, folder: Path, record: str) -> dict[str, tuple[str, Path]]:
        """By a file's path in an output folder: its SHA-256, and its path in the store."""
        if record == CONTENTS:
            key, files = read_contents(folder)
            return {name: (digest, self.store.folder_of(key) / name) for name, digest in files.items()}
        return {
            name: (digest, self.store.folder_of(entry.key) / stored_name(name, entry.name))
            for entry in read_manifest(folder).shards
            for name, digest in entry.files.items()
        }

    def _outputs(self) -> dict[Path, dict[str, str]]:
        """By output folder, DVC's MD5 of each of its files."""
        try:
            locked = YAML(typ="safe", pure=True).load((self.root / _LOCK).read_text()) or {}
            outs = [out for stage in locked.get("stages", {}).values() for out in stage.get("outs", ())]
        except (OSError, YAMLError, AttributeError) as error:
            raise ShardError(f"{self.root / _LOCK} cannot be read ({error}); run `make repro`") from None
        found = {}
        for out in outs:
            with suppress(OSError, ValueError, TypeError, KeyError):  # not in the cache
                rows: list[dict[str, Any]] = json.loads(self._cached(out["md5"]).read_bytes())
                found[self.root / out["path"]] = {row["relpath"]: row["md5"] for row in rows}
        return found

    def _cached(self, md5: str) -> Path:
        return self.cache / md5[:2] / md5[2:]


def _is_whole(folder: Path, record: str) -> bool:
    try:
        read_contents(folder) if record == CONTENTS else read_manifest(folder)
    except ShardError:
        return False
    return True


def _hashes(path: Path) -> tuple[str, str]:
    """SHA-256 and MD5."""
    sha256, md5 = hashlib.sha256(), hashlib.md5(usedforsecurity=False)
    with open(path, "rb") as file:
        while block := file.read(2**20):
            sha256.update(block)
            md5.update(block)
    return sha256.hexdigest(), md5.hexdigest()
