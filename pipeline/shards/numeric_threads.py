"""How many threads the numeric libraries may use. With several, the order of a sum and so its last bit can vary."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS")


def thread_variables(count: int) -> dict[str, str]:
    """The environment in which every numeric library uses `count` threads from its first import on."""
    return dict.fromkeys(_VARIABLES, str(count))


@contextmanager
def threads_of_children(count: int) -> Iterator[None]:
    """Processes started meanwhile get `count` threads in every numeric library, from their first import on."""
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(thread_variables(count))
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
    """The BLAS, OpenMP (torch's too) and numba that this process has loaded use `count` threads meanwhile."""
    numba = sys.modules.get("numba")
    numba_before = numba.get_num_threads() if numba else None
    if numba:
        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    try:
        with threadpool_limits(limits=count):
            yield
    finally:
        if numba:
            numba.set_num_threads(numba_before)
