"""Putting a file of the store where the user reads it.

By reflink where the file system has them, else by hard link, else by copy. A hard link shares its bytes with
the store, which is safe because nothing here ever writes in place: files are made under a temporary name and
renamed, they are read-only from then on (DVC makes them so too), DVC removes an output instead of overwriting
it, and should somebody write in place all the same, the store notices by the hash and computes the shard again.
A copy would cost the disk twice, and DVC a second hashing (its record is by inode and time).
"""

import fcntl
import os
import shutil
from pathlib import Path

_FICLONE = 0x40049409  # linux/fs.h


def place(source: Path, target: Path) -> None:
    """Make `target` (which must not exist) the same file as `source`."""
    if not (_reflink(source, target) or _hard_link(source, target)):
        shutil.copyfile(source, target)
        target.chmod(0o444)


def _reflink(source: Path, target: Path) -> bool:
    try:
        with open(source, "rb") as original, open(target, "xb") as clone:
            fcntl.ioctl(clone.fileno(), _FICLONE, original.fileno())
    except OSError:
        target.unlink(missing_ok=True)
        return False
    target.chmod(0o444)
    return True


def _hard_link(source: Path, target: Path) -> bool:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        return False
    return True
