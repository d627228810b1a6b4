"""Folders that replace others: under kills, links, and several commands at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.api.result_folder import result_folder, write_result
from pipeline.errors import OutputError
from pipeline.shards.beside import beside, put_in_place
from pipeline.shards.code_hash import ROOT


def result(target: Path, text: str, force: bool = False) -> None:
    with result_folder(target, force) as folder:
        (folder / "text").write_text(text)
        write_result(folder, "test", {})


@pytest.mark.parametrize("step", ["filled", "moved"])
def test_a_kill_leaves_what_was_there_and_does_not_block_the_next_run(tmp_path: Path, step: str) -> None:
    result(tmp_path / "out", "old")
    program = f"""
import os
from pathlib import Path
from pipeline.shards import beside
target = Path({str(tmp_path / "out")!r})
with beside.beside(target) as new:
    (new / "text").write_text("new")
    if {step!r} == "moved":  # between the two renames
        Path.rename = lambda self, to: (os.rename(self, to), os.kill(os.getpid(), 9))
        beside.put_in_place(new, target)
    os.kill(os.getpid(), 9)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    assert subprocess.run([sys.executable, "-c", program], env=environment).returncode == -9
    with pytest.raises(OutputError, match="exists already"):
        result(tmp_path / "out", "newer")
    assert (tmp_path / "out" / "text").read_text() == "old"
    result(tmp_path / "out", "newer", force=True)
    assert (tmp_path / "out" / "text").read_text() == "newer"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_of_commands_at_once_with_one_output_the_first_to_end_wins(tmp_path: Path) -> None:
    def both() -> None:
        with result_folder(tmp_path / "out", False) as folder:
            (folder / "text").write_text("second")
            result(tmp_path / "out", "first")

    with pytest.raises(OutputError, match="exists already"):
        both()
    assert (tmp_path / "out" / "text").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_user_s_own_files_beside_the_output_stay(tmp_path: Path) -> None:
    for name in (".out.partial", ".out.replaced", ".out.1.partial"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine").touch()
    result(tmp_path / "out", "text")
    assert len(list(tmp_path.glob(".out*/mine"))) == 3


def test_links_and_dots_lead_to_the_folder_that_they_name(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real" / "out")
    result(tmp_path / "link", "by a link")
    assert (tmp_path / "link").is_symlink()
    result(tmp_path / "link", "again", force=True)
    assert (tmp_path / "real" / "out" / "text").read_text() == "again"
    result(tmp_path / "real" / ".." / "other", "dots")
    assert (tmp_path / "other" / "text").read_text() == "dots"


@pytest.mark.parametrize("name", ["x" * 256, "loop/out", "a\0b"])
def test_a_name_that_no_file_can_have_is_one_error(tmp_path: Path, name: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(OutputError, match=r"cannot write|cannot be written"):
        result(tmp_path / name, "text")


def test_long_and_strange_names_are_possible(tmp_path: Path) -> None:
    for name in ("x" * 255, "ü" * 120, os.fsdecode(b"\xff\xfe")):
        result(tmp_path / name, "text")
        result(tmp_path / name, "text", force=True)
    assert len(list(tmp_path.iterdir())) == 3


def test_an_error_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()

    def fail() -> None:
        with beside(tmp_path / "out") as new:
            (new / "text").touch()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    with beside(tmp_path / "out") as new:
        (new / "text").touch()
        put_in_place(new, tmp_path / "out")
    assert (tmp_path / "out" / "text").exists()
