"""Laws of the Parquet shards."""

import itertools
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pipeline.shards.tables import read_table, table_from_rows, write_table

SCHEMA = pa.schema([("clip", pa.int64()), ("name", pa.string()), ("points", pa.list_(pa.float32()))])


def random_table(rng: np.random.Generator, rows: int) -> pa.Table:
    points = [rng.normal(size=int(rng.integers(5))).astype(np.float32).tolist() for _ in range(rows)]
    return table_from_rows([{"clip": k, "name": f"ball_{k % 3}", "points": p} for k, p in enumerate(points)], SCHEMA)


def test_reading_gives_what_was_written(tmp_path: Path, rng: np.random.Generator) -> None:
    table = random_table(rng, 50)
    write_table(table, tmp_path / "t.parquet")
    assert read_table(tmp_path / "t.parquet").equals(table)


def test_the_bytes_do_not_show_in_what_pieces_the_rows_came(tmp_path: Path, rng: np.random.Generator) -> None:
    table = random_table(rng, 3000)
    cuts = [0, *sorted(rng.choice(np.arange(1, 3000), 4, replace=False).tolist()), 3000]
    pieces = pa.concat_tables([table.slice(a, b - a) for a, b in itertools.pairwise(cuts)])
    write_table(table, tmp_path / "whole.parquet")
    write_table(pieces, tmp_path / "pieces.parquet")
    assert (tmp_path / "whole.parquet").read_bytes() == (tmp_path / "pieces.parquet").read_bytes()


def test_the_bytes_do_not_show_whether_pandas_made_the_table(tmp_path: Path, rng: np.random.Generator) -> None:
    table = random_table(rng, 20)
    write_table(table, tmp_path / "rows.parquet")
    write_table(pa.Table.from_pandas(table.to_pandas(), schema=SCHEMA), tmp_path / "pandas.parquet")
    assert (tmp_path / "rows.parquet").read_bytes() == (tmp_path / "pandas.parquet").read_bytes()


def test_rows_must_have_exactly_the_columns_of_the_schema() -> None:
    with pytest.raises(KeyError, match=r"row 1: unknown columns \['nmae'\], missing columns \['name'\]; valid:"):
        table_from_rows([{"clip": 0, "name": "a", "points": []}, {"clip": 1, "nmae": "b", "points": []}], SCHEMA)


def test_a_column_whose_type_is_not_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="explicit type"):
        write_table(pa.table({"clip": [0], "points": pa.array([[]])}), tmp_path / "t.parquet")


def test_hugging_face_datasets_reads_a_folder_of_shards(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    import datasets  # which takes seconds

    tables = [random_table(rng, 5) for _ in range(2)]
    for k, table in enumerate(tables):
        write_table(table, tmp_path / f"shard-0000{k}-of-00002.parquet")
    files = str(tmp_path / "shard-*.parquet")
    loaded = datasets.load_dataset("parquet", data_files=files, split="train", cache_dir=str(tmp_path / "cache"))
    assert loaded.to_list() == pa.concat_tables(tables).to_pylist()
