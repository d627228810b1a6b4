"""One BLAS thread wherever the library is used: two slow its small matrices down."""

import os
import subprocess
import sys

import pytest

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
