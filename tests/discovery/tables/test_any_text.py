"""Whatever a file holds, reading it ends in rows or in one error of ours."""

from contextlib import suppress
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.discovery.tables.motion_table import read_motion_table
from pipeline.discovery.tables.said import Said
from pipeline.errors import DynamicsError

WORDS = st.sampled_from(
    [
        "t",
        "time (ms)",
        "x",
        "y [cm]",
        "z",
        "clip",
        "object",
        "ball",
        "x_1",
        "Run 1: X (m)",
        "frame",
        "#multi:",
        "\t",
        ";",
    ]
)
NUMBERS = st.floats(-1e4, 1e4).map("{:.4g}".format) | st.integers(-9, 99).map(str) | st.sampled_from(["", "nan", "1,5"])
CELLS = st.lists(st.lists(WORDS | NUMBERS | st.text(max_size=4), max_size=7), max_size=12)


@settings(max_examples=200, deadline=None)
@given(rows=CELLS, separator=st.sampled_from([",", ";", "\t", " "]), begin=st.sampled_from(["", "# ", "\ufeff"]))
def test_texts_are_read_or_refused(rows: list[list[str]], separator: str, begin: str, tmp_path_factory) -> None:  # type: ignore[no-untyped-def]
    refuses_or_reads(
        (begin + "\n".join(separator.join(row) for row in rows)).encode(errors="replace"),
        tmp_path_factory.getbasetemp(),
    )


@settings(max_examples=100, deadline=None)
@given(begin=st.sampled_from([b"", b"PK\3\4", b"\xff\xfe", b"\xd0\xcf\x11\xe0"]), data=st.binary(max_size=200))
def test_bytes_are_read_or_refused(begin: bytes, data: bytes, tmp_path_factory) -> None:  # type: ignore[no-untyped-def]
    refuses_or_reads(begin + data, tmp_path_factory.getbasetemp())


def refuses_or_reads(data: bytes, folder: Path) -> None:
    path = folder / "any.txt"
    path.write_bytes(data)
    with suppress(DynamicsError):
        assert {"clip", "object", "time", "x", "y", "z"} <= set(read_motion_table(path, {"ball": 0.05}, Said()).rows)
