"""One BLAS thread wherever the library is used: two slow its small matrices down."""

import os
import subprocess
import sys

import numba
import pytest
import torch
from threadpoolctl import threadpool_info

from pipeline.shards.numeric_threads import threads_here

TOLD = """
import os, sys
seen = []
sys.addaudithook(lambda event, a: event == "import" and a[0] == "numpy" and seen.append(os.environ.get({name!r})))
import {module}, numpy
print(seen[0])
"""


@pytest.mark.parametrize("module", ["pipeline.commands.main", "benchmarks.search", "stages.fit"])
def test_blas_is_limited_before_numpy_is_imported(module: str) -> None:
    told = TOLD.format(module=module, name="OPENBLAS_NUM_THREADS")
    clean = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    said = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, env=clean)
    assert said.returncode == 0, said.stderr
    assert said.stdout.split() == ["1"]


def threads() -> set[int]:
    return {torch.get_num_threads(), numba.get_num_threads(), *(pool["num_threads"] for pool in threadpool_info())}


@pytest.mark.parametrize("count", [1, 2])
def test_every_loaded_library_uses_the_threads_it_is_given_and_afterwards_its_own(count: int) -> None:
    before = threads()
    with threads_here(min(count, os.cpu_count() or 1)):
        assert threads() == {min(count, os.cpu_count() or 1)}
    assert threads() == before
