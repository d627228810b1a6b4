"""A new folder beside the one that it will replace, under a name that no other process uses."""

import fcntl
import os
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def beside(target: Path) -> Iterator[Path]:
    """An empty folder `.<name>.<random>.partial` beside `target`, removed at the end where it is still there.

    Those of processes that were killed are removed before; where one was killed while it replaced `target`, what it
    replaced is put back first.
    """
    _recover(target)
    while True:
        path = target.parent / f".{_short(target)}.{uuid.uuid4().hex}.partial"
        path.mkdir(parents=True)
        with suppress(FileNotFoundError):  # another process took it for abandoned
            handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
            break
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield path
    finally:
        os.close(handle)
        shutil.rmtree(path, ignore_errors=True)


def put_in_place(new: Path, target: Path) -> None:
    """Rename the folder `new` to `target`, which is replaced where it is there; after an error it is as it was."""
    if not target.exists():
        new.rename(target)
        return
    old = target.parent / f".{_short(target)}.{uuid.uuid4().hex}.replaced"
    target.rename(old)
    try:
        new.rename(target)
    except OSError:
        old.rename(target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _recover(target: Path) -> None:
    pattern = re.compile(rf"\.{re.escape(_short(target))}\.[0-9a-f]{{32}}\.(partial|replaced)")
    left = [path for path in target.parent.iterdir() if pattern.fullmatch(path.name)] if target.parent.is_dir() else []
    for path in left:
        if path.suffix == ".replaced":
            with suppress(OSError):
                if target.exists():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.rename(target)
        elif _is_abandoned(path):
            shutil.rmtree(path, ignore_errors=True)


def _is_abandoned(path: Path) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def _short(target: Path) -> str:
    """A name may have 255 bytes with what stands before and after it."""
    return os.fsdecode(os.fsencode(target.name)[:150])
