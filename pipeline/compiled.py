"""Decorators for functions that numba compiles, and the folder in which the compiled code is cached.

Numba detects a change in the file of a function, but not in the files of the functions that it calls. Therefore the
cache folder is named by a hash of all files with kernels.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numba


def _kernel_folder() -> Path:
    """The cache folder: in NUMBA_CACHE_DIR, else in the user's cache, else a new temporary one.

    Numba unpickles what is in it. So a folder of another user, or one that others may write to, is not used.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        text = source.read_bytes()
        if b"pipeline.compiled import" in text:
            digest.update(text)
    configured = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dynamics"
    for base in ([Path(configured)] if configured else []) + [home]:
        folder = base / f"kernels-{digest.hexdigest()[:16]}"
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            state = folder.stat()
        except OSError:
            continue
        if os.access(folder, os.W_OK) and state.st_uid == os.geteuid() and not state.st_mode & 0o002:
            return folder
    return Path(tempfile.mkdtemp(prefix="dynamics-kernels-"))


numba.config.CACHE_DIR = str(_kernel_folder())  # type: ignore[attr-defined]

#: Compiles a function at its first call. It releases the GIL, and x / 0 is inf or nan as in NumPy.
kernel = numba.njit(cache=True, nogil=True, error_model="numpy")
#: Like `kernel`, with `numba.prange` in threads.
parallel_kernel = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
#: Like `kernel`, for functions with array arguments that are called for each pixel. They are inlined, because reference
#: counting of the arrays at each call would double the time.
inlined_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
