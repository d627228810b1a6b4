"""The README's Python examples run as they stand, from the root of the project."""

import re
from pathlib import Path

import pytest

from pipeline.shards.code_hash import ROOT

BLOCKS = re.findall(
    r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
)


@pytest.mark.slow
def test_the_readmes_python_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    assert BLOCKS
    for code in BLOCKS:
        exec(compile(code, "README.md", "exec"), {})
