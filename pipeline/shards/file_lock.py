"""Locks of files, which the system releases when their holder ends, on whatever machine or in whatever container.

A process id says nothing about a process of another container or machine; a lock does. Over NFS, Linux turns these
locks into locks of the server.
"""

import fcntl
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_SUFFIX = ".lock"


@contextmanager
def locked(path: Path, *, shared: bool = False, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of the file `path`, which is made where it is missing. Gives whether it is held: False only where
    another holds it and `wait` is false."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mode = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB)
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            try:
                fcntl.flock(handle, mode)
            except BlockingIOError:
                yield False
                return
            if _is_open_file(handle, path):  # else its last holder has removed it meanwhile
                yield True
                return
        finally:
            os.close(handle)


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """A new path in `folder` for this process alone. It is to be removed inside; after a kill `abandoned` gives it."""
    path = folder / uuid.uuid4().hex
    with locked(_lock_of(path)):
        try:
            yield path
        finally:
            with suppress(OSError):
                _lock_of(path).unlink()


def abandoned(folder: Path) -> Iterator[Path]:
    """The claimed paths in `folder` whose processes have ended; each is to be removed before the next is asked for."""
    for path in _claimed_paths(folder):
        with locked(_lock_of(path), wait=False) as held:
            if held:
                yield path
                with suppress(OSError):
                    _lock_of(path).unlink()


def live_claims(folder: Path) -> Iterator[Path]:
    """The claimed paths in `folder` whose processes run."""
    for path in _claimed_paths(folder):
        with locked(_lock_of(path), wait=False) as held:
            if not held:
                yield path


def _claimed_paths(folder: Path) -> list[Path]:
    """With or without their lock: a kill may leave either."""
    names = {path.name.removesuffix(_SUFFIX) for path in folder.iterdir()} if folder.is_dir() else set()
    return [folder / name for name in sorted(names)]


def _lock_of(path: Path) -> Path:
    return path.with_name(path.name + _SUFFIX)


def _is_open_file(handle: int, path: Path) -> bool:
    try:
        there, here = os.stat(path), os.fstat(handle)
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (here.st_dev, here.st_ino)
