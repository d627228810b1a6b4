"""One Parquet file per table and shard: explicit schema, and the same bytes for the same rows.

`datasets.load_dataset("parquet", data_files="data/sample/train/shard-*.parquet")` reads them as they are.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

CLIP_COLUMN = "clip"  # every table has it: the clip's index in its suite, never decreasing
ZSTD_LEVEL = 3
_ROWS_PER_GROUP = 1024


def table_from_rows(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.Table:
    """A table of `rows` with exactly the columns of `schema`.

    Unlike `pa.Table.from_pylist`, which drops unknown keys and fills missing ones with nulls, it raises
    KeyError for either.
    """
    names = set(schema.names)
    for number, row in enumerate(rows):
        if row.keys() != names:
            unknown, missing = sorted(row.keys() - names), sorted(names - row.keys())
            raise KeyError(f"row {number}: unknown columns {unknown}, missing columns {missing}; valid: {schema.names}")
    return pa.Table.from_pylist([dict(row) for row in rows], schema=schema)


def write_table(table: pa.Table, path: Path) -> None:
    """Write `table` to `path`. The bytes depend on the rows, the schema and the pyarrow version alone."""
    assert not _has_null_type(table.schema), f"give an explicit type to every column: {table.schema}"
    metadata = {key: value for key, value in (table.schema.metadata or {}).items() if key != b"pandas"}
    table = table.replace_schema_metadata(dict(sorted(metadata.items())) or None)
    pq.write_table(
        table.combine_chunks(),  # the bytes must not depend on how the rows were chunked
        path,
        row_group_size=_ROWS_PER_GROUP,
        version="2.6",
        data_page_version="1.0",
        compression="zstd",
        compression_level=ZSTD_LEVEL,
        use_dictionary=True,
        write_statistics=True,
        write_page_checksum=True,
    )


def read_table(path: Path) -> pa.Table:
    """Read a table. Raises what pyarrow raises where the file is missing or damaged."""
    # A file object, not a path: pyarrow would turn `a=b/` in a path into a column, and might map the file.
    with open(path, "rb") as file:
        return pq.ParquetFile(file).read()


def _has_null_type(schema: pa.Schema) -> bool:
    return any(_type_has_null(field.type) for field in schema)


def _type_has_null(kind: pa.DataType) -> bool:
    return pa.types.is_null(kind) or any(_type_has_null(kind.field(k).type) for k in range(kind.num_fields))
