"""The operating system's errors on writing, as one `OutputError` that names the place."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import OutputError

_REASONS = {
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than is allowed here",
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "writing is not permitted",
    errno.EPERM: "writing is not permitted",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ELOOP: "it is a link in a circle",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
}


@contextmanager
def writing_to(place: Path | str) -> Iterator[None]:
    """Turn the errors of a full, read-only or forbidden `place` into OutputError; other errors pass."""
    try:
        yield
    except OSError as error:
        if error.errno not in _REASONS:
            raise
        file = str(error.filename or "")
        where = f" ({file})" if file and not Path(file).is_relative_to(place) else ""
        raise OutputError(f"cannot write to {os.fspath(place)}: {_REASONS[error.errno]}{where}") from error
