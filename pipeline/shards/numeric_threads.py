"""How many threads a numeric library may use, so that a sum's order, and so its last bit, is always the same."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS")


@contextmanager
def threads_of_children(count: int) -> Iterator[None]:
    """Processes started meanwhile get `count` threads in every numeric library."""
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def threads_here(count: int) -> Iterator[None]:
    """torch and numba, where this process has loaded them, use `count` threads meanwhile.

    A BLAS that is loaded already can only be limited before: stages/__init__.py does.
    """
    torch, numba = sys.modules.get("torch"), sys.modules.get("numba")
    torch_before = torch.get_num_threads() if torch else None
    numba_before = numba.get_num_threads() if numba else None
    if torch:
        torch.set_num_threads(count)
    if numba:
        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    try:
        yield
    finally:
        if torch:
            torch.set_num_threads(torch_before)
        if numba:
            numba.set_num_threads(numba_before)
