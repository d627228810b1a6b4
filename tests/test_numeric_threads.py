"""One BLAS thread wherever the library is used: two slow its small matrices down."""

import os
import subprocess
import sys

import pytest

TOLD = """
import {module}, numpy
from threadpoolctl import threadpool_info
print(*(p["num_threads"] for p in threadpool_info() if p["internal_api"] == "openblas"))
"""


@pytest.mark.parametrize("module", ["pipeline.commands.main", "benchmarks.search", "stages.fit"])
def test_blas_has_one_thread(module: str) -> None:
    pytest.importorskip("threadpoolctl")
    clean = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    said = subprocess.run([sys.executable, "-c", TOLD.format(module=module)], capture_output=True, text=True, env=clean)
    assert said.returncode == 0, said.stderr
    assert set(said.stdout.split()) == {"1"}
