"""CSV files from rows and back."""

from pathlib import Path

from pipeline.csv_rows import append_row, read_rows, write_rows


def test_rows_are_read_as_they_were_written_and_missing_cells_are_empty(tmp_path: Path) -> None:
    file = tmp_path / "new" / "rows.csv"
    write_rows(file, [{"a": 1, "b": 1 / 3}, {"a": 2, "c": "x,y"}])
    assert read_rows(file) == [{"a": "1", "b": "0.333333", "c": ""}, {"a": "2", "b": "", "c": "x,y"}]
    write_rows(file, [{"a": 1, "b": 2.5}], ("b",))
    assert file.read_bytes() == b"b\n2.5\n"
    write_rows(file, [], ("step", "loss"))
    assert file.read_text() == "step,loss\n"


def test_a_log_has_one_header(tmp_path: Path) -> None:
    for step in range(3):
        append_row(tmp_path / "log.csv", {"step": step, "loss": 0.5})
    assert [row["step"] for row in read_rows(tmp_path / "log.csv")] == ["0", "1", "2"]
