"""The decorator of functions that numba compiles, and where their machine code is kept.

Numba notices a change in a function's own file, but not in those of the functions it calls: kernels would go on
with old code inside. So the code is kept in a folder named by the text of all files that have kernels.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numba


def _kernel_folder() -> Path:
    """Where the machine code goes: under NUMBA_CACHE_DIR, else the user's cache, else the temporary folder."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        text = source.read_bytes()
        if b"pipeline.compiled import" in text:
            digest.update(text)
    configured = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dynamics"
    for base in ([Path(configured)] if configured else []) + [home, Path(tempfile.gettempdir()) / "dynamics"]:
        folder = base / f"kernels-{digest.hexdigest()[:16]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="dynamics-kernels-"))


numba.config.CACHE_DIR = str(_kernel_folder())  # type: ignore[attr-defined]

#: Compiles a function at its first call; without the interpreter's lock, and x / 0 is inf or nan, as in NumPy.
kernel = numba.njit(cache=True, nogil=True, error_model="numpy")
#: The same with `numba.prange` in threads.
parallel_kernel = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
#: As `kernel`, for a function that is called for each pixel and takes arrays: put into its callers, for otherwise each
#: call counts references to its arrays, which doubles the time.
inlined_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
