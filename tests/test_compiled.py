from pathlib import Path

import pytest

from pipeline import compiled


def test_a_change_in_any_file_with_kernels_moves_the_machine_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = tmp_path / "pipeline"
    sources.mkdir()
    monkeypatch.setattr(compiled, "__file__", str(sources / "compiled.py"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    kernel, other = sources / "kernel.py", sources / "other.py"
    kernel.write_text("from pipeline.compiled import kernel\n")
    other.write_text("1\n")
    first = compiled._kernel_folder()
    other.write_text("2\n")
    assert compiled._kernel_folder() == first
    kernel.write_text("from pipeline.compiled import kernel  # changed\n")
    assert compiled._kernel_folder() != first


def test_without_a_place_to_write_the_machine_code_goes_to_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "numba"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "home"))
    monkeypatch.setattr(compiled.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    assert (tmp_path / "temporary") in compiled._kernel_folder().parents
