"""Which files are taken, and what is left of one that breaks off."""

import io
from pathlib import Path

import pytest

from pipeline.app.uploads import KINDS, UploadError, check_upload, receive, shown_name


def test_the_ending_and_the_size_of_a_file_are_checked_before_it_is_read() -> None:
    assert check_upload("clip", "a b.MP4", 10) == ".mp4"
    with pytest.raises(UploadError, match=r"notes.txt is no video; valid: .mp4"):
        check_upload("clip", "notes.txt", 10)
    with pytest.raises(UploadError, match=r"long.mp4 has 2,048 MiB; at most 500 MiB"):
        check_upload("clip", "long.mp4", 2**31)
    with pytest.raises(UploadError, match="is empty"):
        check_upload("table", "a.csv", 0)
    with pytest.raises(UploadError, match="valid: clip, table, scene"):
        check_upload("program", "a.py", 1)
    assert all(kind.most_bytes < 2**30 for kind in KINDS.values())


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "..\\..\\a.mp4", "a\x00b.mp4", "/x/" + "y" * 300 + ".mp4", "", ".."]
)
def test_a_name_is_only_its_last_part_without_tricks(name: str) -> None:
    shown = shown_name(name)
    assert "/" not in shown and "\\" not in shown and "\x00" not in shown
    assert 0 < len(shown) <= 80
    assert shown not in (".", "..")


def test_nothing_is_left_of_an_upload_that_breaks_off(tmp_path: Path) -> None:
    receive(io.BytesIO(b"12345"), 5, tmp_path / "whole")
    assert (tmp_path / "whole").read_bytes() == b"12345"
    with pytest.raises(UploadError, match="broke off"):
        receive(io.BytesIO(b"123"), 5, tmp_path / "part")
    assert [p.name for p in tmp_path.iterdir()] == ["whole"]
