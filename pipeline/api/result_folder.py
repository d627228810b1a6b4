"""A command's output folder: whole or not at all, and never at the cost of somebody's files."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pipeline.errors import OutputError
from pipeline.inference.progress import Progress
from pipeline.shards.beside import beside, put_in_place
from pipeline.shards.output_errors import writing_to
from pipeline.untrusted import read_json

RESULT, TIMES = "result.json", "times.json"


class FolderResult(ABC):
    """What a command found, which can be saved as a folder."""

    @abstractmethod
    def write(self, folder: Path, progress: Progress) -> None:
        """Write all files into a folder, result.json last; progress is told of them."""

    def save(self, out: str | Path, force: bool = False, progress: Progress | None = None) -> None:
        """Write all files into a new folder.

        Args:
            out: The folder, which must not exist yet.
            force: Replace it where `dynamics` wrote it and nothing else is in it.
            progress: Told of the files; None: nothing is printed.

        Raises:
            OutputError: Where it cannot be written; nothing is left then.
        """
        with result_folder(Path(out), force) as folder:
            self.write(folder, progress or Progress())


@contextmanager
def result_folder(target: Path, force: bool) -> Iterator[Path]:
    """A new folder to fill; on leaving it becomes `target`, and after an error nothing of it is left.

    Raises OutputError where `target` cannot be written or holds something: with `force`, a folder of ours is replaced
    as long as there are no other files in it.
    """
    place = _resolved(target)
    made: list[Path] = []
    with writing_to(target):
        try:
            made = _make_parents(place.parent)
            with beside(place) as temporary:
                check_replaceable(target, force)  # after `beside` has put back what a killed run had moved away
                yield temporary
                check_replaceable(target, force)  # another command may have written it meanwhile
                put_in_place(temporary, place)
        except BaseException:
            for folder in reversed(made):
                with suppress(OSError):  # another command has put something there
                    folder.rmdir()
            raise


def write_result(folder: Path, command: str, result: dict[str, Any], seconds: dict[str, float] | None = None) -> None:
    """Write result.json: the command, its result, and the names of all files of the folder, itself included.

    seconds: of each step; they and the time of day go to times.json, so that equal runs have equal results.
    """
    if seconds is not None:
        times = {"made": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "seconds": seconds}
        (folder / TIMES).write_text(json.dumps(times, indent=1) + "\n", encoding="utf-8")
    files = sorted({RESULT, *(path.name for path in folder.iterdir())})
    text = json.dumps({"command": command, **result, "files": files}, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / RESULT).write_bytes((text + "\n").encode("utf-8", "backslashreplace"))


def check_replaceable(target: Path, force: bool) -> None:
    """Raise OutputError where `target` is in the way."""
    try:
        if not target.exists():
            return
    except (OSError, ValueError) as error:  # a name that is too long, or that has a null byte
        raise OutputError(f"{target} cannot be written to: {getattr(error, 'strerror', None) or error}") from None
    if not target.is_dir():
        raise OutputError(f"{target} is a file; the results go into a folder of that name")
    there = {path.name for path in target.iterdir()}
    if not there:
        return
    own = _own_files(target)
    if own is None:
        raise OutputError(f"{target} is not empty and was not made by `dynamics`: choose another folder")
    foreign = sorted(there - own)
    if foreign:
        raise OutputError(f"{target} also holds {foreign[0]}, which `dynamics` did not write: choose another folder")
    if not force:
        raise OutputError(f"{target} exists already: choose another folder, or give --force to replace it")


def _own_files(folder: Path) -> set[str] | None:
    """The names that the folder's result.json lists; None where it has none of ours."""
    try:
        result = read_json(folder / RESULT, OutputError)
        return set(result["files"]) if "command" in result else None
    except (OutputError, KeyError, TypeError):
        return None


def _make_parents(folder: Path) -> list[Path]:
    """Make a folder and those above it; the ones that were made, from the top."""
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for path in reversed(missing):
        path.mkdir()
    return missing[::-1]


def _resolved(target: Path) -> Path:
    """The path without links and `..`. Raises OutputError for links in a circle and names that no file can have."""
    try:
        return target.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a circle, or a null byte
        raise OutputError(f"{target} cannot be written to: {getattr(error, 'strerror', None) or error}") from None
