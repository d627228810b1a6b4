"""dvc.lock that a killed DVC leaves cut."""

from pathlib import Path

import pytest

from pipeline.shards.code_hash import ROOT
from stages.graph import lock_copy
from stages.graph.run import run


@pytest.fixture
def lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".dvc/tmp").mkdir(parents=True)
    (tmp_path / "dvc.lock").write_bytes((ROOT / "dvc.lock").read_bytes())
    return (ROOT / "dvc.lock").read_bytes()


@pytest.mark.parametrize("length", [0, 1000, -1000])
def test_a_cut_lock_is_put_back_as_the_last_stage_found_it(lock: bytes, length: int) -> None:
    run(lambda: None, [])
    assert lock_copy.restore() is None
    Path("dvc.lock").write_bytes(lock[:length])
    done = lock_copy.restore()
    assert done is not None
    assert "put back" in done
    assert Path("dvc.lock").read_bytes() == lock


def test_without_a_copy_a_cut_lock_is_removed_and_it_is_said(lock: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    Path("dvc.lock").write_bytes(b"")
    lock_copy.main()
    assert not Path("dvc.lock").exists()
    assert "there is no copy" in capsys.readouterr().err
    lock_copy.main()
    assert capsys.readouterr().err == ""


def test_an_empty_lock_does_not_replace_the_copy(lock: bytes) -> None:
    lock_copy.keep()
    Path("dvc.lock").write_bytes(b"")
    lock_copy.keep()
    assert lock_copy.COPY.read_bytes() == lock
