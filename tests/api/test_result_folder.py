"""An output folder is whole or not there, and nobody's files are lost."""

from pathlib import Path

import pytest

from pipeline.api.result_folder import RESULT, result_folder, write_result
from pipeline.errors import OutputError


def fill(target: Path, text: str, force: bool = False) -> None:
    with result_folder(target, force) as folder:
        (folder / "scene.yaml").write_text(text)
        write_result(folder, "test", {"text": text})


def content(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_nothing_is_at_the_place_before_everything_is(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "out"
    with result_folder(target, False) as folder:
        (folder / "x").write_text("1")
        assert not target.exists()
    assert [p.name for p in target.iterdir()] == ["x"]
    assert [p.name for p in target.parent.iterdir()] == ["out"]


def test_after_an_error_nothing_is_left_not_even_the_folders_above(tmp_path: Path) -> None:
    def interrupted() -> None:
        with result_folder(tmp_path / "a" / "b" / "out", False) as folder:
            (folder / "x").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_result_is_replaced_with_force_alone_and_stays_where_the_new_one_fails(tmp_path: Path) -> None:
    target = tmp_path / "out"
    fill(target, "old")
    before = content(target)
    with pytest.raises(OutputError, match="--force"):
        fill(target, "new")
    with pytest.raises(ZeroDivisionError), result_folder(target, True):
        raise ZeroDivisionError
    assert content(target) == before
    fill(target, "new", force=True)
    assert content(target)["scene.yaml"] == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    fill(tmp_path / "out", "new")
    assert content(tmp_path / "out")["scene.yaml"] == "new"


@pytest.mark.parametrize("name", ["thesis.tex", RESULT])
def test_files_of_others_are_never_touched(tmp_path: Path, name: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("{}")
    for force in (False, True):
        with pytest.raises(OutputError, match="choose another folder"):
            fill(tmp_path / "out", "new", force)
    assert content(tmp_path / "out") == {name: "{}"}


def test_a_file_that_was_added_to_a_result_is_kept(tmp_path: Path) -> None:
    fill(tmp_path / "out", "old")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"notes\.txt"):
        fill(tmp_path / "out", "new", force=True)
    assert content(tmp_path / "out")["notes.txt"] == "mine"


@pytest.mark.parametrize("place", ["file", "file/out", "file/a/out"])
def test_a_file_in_the_way_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="file"):
        fill(tmp_path / place, "new", force=True)
    assert content(tmp_path) == {"file": "mine"}
