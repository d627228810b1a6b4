"""Reading what the user gives.

Nothing in it is executed, sizes are bounded before anything is decoded, and every failure is one error of the caller's
kind that names the file.

docs/security.md says what is trusted and what is not.
"""

from __future__ import annotations

import io
import json
import math
import os
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import numpy as np
from PIL import Image
from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent

from pipeline.errors import DynamicsError

MOST_TEXT_BYTES = 2**20  # of YAML and JSON: a scene of 1,000 bodies takes a third
MOST_YAML_DEPTH = 40
MOST_PIXELS = 2**26  # of a picture: 67 megapixels
MOST_ARRAY_BYTES = 2**32
MOST_TABLE_BYTES = 2**30
MOST_TABLE_ROWS = 20_000_000
MOST_MESH_BYTES = 2**28
MOST_HEADER_CHARACTERS = 10_000  # of an array in an NPZ

ErrorKind = type[DynamicsError]


@contextmanager
def open_untrusted(path: Path, error: ErrorKind, most_bytes: int | None = None) -> Iterator[BinaryIO]:
    """A regular file of bounded size, opened for reading.

    Folders, devices, sockets and pipes are refused; a pipe without a writer would be waited for without end.

    Args:
        path: The file.
        error: What is raised, here and for what the system reports while the file is read.
        most_bytes: The largest size; None: any.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise error(f"{path}: there is no such file") from None
    except (OSError, ValueError) as problem:  # ValueError: a null byte in the name
        raise error(f"{path} cannot be read: {getattr(problem, 'strerror', None) or problem}") from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        kind = "a folder" if stat.S_ISDIR(state.st_mode) else "a pipe or a device"
        raise error(f"{path} is {kind}, not a file")
    with os.fdopen(handle, "rb") as file:
        if most_bytes is not None and state.st_size > most_bytes:
            raise error(f"{path} has {_amount(state.st_size)}; at most {_amount(most_bytes)} are read")
        try:
            yield file
        except OSError as problem:
            raise error(f"{path} cannot be read: {problem.strerror or problem}") from None


def read_bytes(path: Path, error: ErrorKind, most_bytes: int = MOST_TEXT_BYTES) -> bytes:
    """All of a file. Raises `error` where it is longer, even where the system told another size (as of /proc)."""
    with open_untrusted(path, error, most_bytes) as file:
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise error(f"{path} has more than {_amount(most_bytes)}, which are the most that are read")
    return data


def read_text(path: Path, error: ErrorKind, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """All of a UTF-8 file."""
    try:
        return read_bytes(path, error, most_bytes).decode("utf-8")
    except UnicodeDecodeError as problem:
        raise error(f"{path}: cannot be read as text: {problem}") from None


class _BoundedComposer(Composer):
    """Without aliases, ten of which make a text of 1 KB a value of gigabytes, and of bounded depth."""

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.parser.check_event(AliasEvent):
            raise ValueError("aliases (*name) are not allowed")
        self.depth += 1
        if self.depth > MOST_YAML_DEPTH:
            raise ValueError(f"more than {MOST_YAML_DEPTH} levels")
        try:
            return super().compose_node(parent, index)
        finally:
            self.depth -= 1


def parse_yaml(text: str, source: str, error: ErrorKind) -> Any:
    """The plain value of a YAML 1.2 text. Raises `error`, which names the line."""
    if len(text) > MOST_TEXT_BYTES:
        raise error(f"{source}: has more than {_amount(MOST_TEXT_BYTES)}, which are the most that are read")
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _BoundedComposer
    try:
        value = yaml.load(text)
        _check_plain(value)
        return value
    except (YAMLError, ValueError, LookupError, RecursionError, TypeError, AttributeError) as problem:
        # The last five: scalars and nesting that ruamel does not expect.
        mark = getattr(problem, "problem_mark", None)
        place = f" at line {mark.line + 1}" if mark else ""
        words = getattr(problem, "problem", None) or str(problem) or type(problem).__name__
        raise error(f"{source}: not YAML{place}: {str(words).splitlines()[0]}") from None


def _check_plain(value: Any) -> None:
    """Raise ValueError for what is no mapping, list, text, truth, date or number of 64 bits, in keys and in values."""
    match value:
        case dict():
            for key, inner in value.items():
                if isinstance(key, tuple):
                    raise ValueError(f"a list is the key of a mapping: {str(key)[:40]}")
                _check_plain(key)
                _check_plain(inner)
        case list():
            for inner in value:
                _check_plain(inner)
        case int():
            if abs(value) >= 2**63:
                raise ValueError(f"a number of {len(str(value))} digits")
        case None | str() | float() | date():  # a date-time is a date
            pass
        case _:
            raise ValueError(f"a value of the kind {type(value).__name__}")


def read_json(path: Path, error: ErrorKind, most_bytes: int = MOST_TEXT_BYTES) -> dict[str, Any]:
    """The object in a JSON file."""
    try:
        found = json.loads(read_bytes(path, error, most_bytes))
    except (ValueError, RecursionError) as problem:
        raise error(f"{path} is not JSON: {problem}") from None
    if not isinstance(found, dict):
        raise error(f"{path} is not a JSON object")
    return found


class _PlainTree(ElementTree.TreeBuilder):
    """Without document types, whose entities make a text of 1 KB one of gigabytes, in whatever encoding it is."""

    def doctype(self, *_: str | None) -> None:
        raise ValueError("document types and entities are not allowed")


def parse_xml(data: bytes, source: str, error: type[Exception]) -> ElementTree.Element:
    """The root of an XML text. Raises `error`, which names the source."""
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_PlainTree()))
    except (ElementTree.ParseError, ValueError, LookupError, RecursionError) as problem:  # LookupError: the encoding
        raise error(f"{source}: not XML that can be read: {problem}") from None


@contextmanager
def open_png(path: Path, error: ErrorKind) -> Iterator[Image.Image]:
    """A PNG picture, checked to be one and small enough before it is decoded.

    Only PNG is tried, whatever the file is: other decoders start programs (EPS starts Ghostscript).
    """
    with open_untrusted(path, error) as file:
        try:
            with Image.open(file, formats=("PNG",)) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise error(f"{path} is {image.width} x {image.height} px; at most {MOST_PIXELS:,} px are read")
                image.load()
                yield image
        except Image.DecompressionBombError as problem:
            raise error(f"{path} has too many pixels; at most {MOST_PIXELS:,} px are read") from problem
        except (OSError, SyntaxError, ValueError) as problem:
            raise error(f"{path} is not a PNG picture, or it is broken") from problem


def read_npz(path: Path, names: tuple[str, ...], error: ErrorKind) -> dict[str, np.ndarray]:
    """The arrays of an NPZ file that are in `names`, as far as it has them; all others are not decoded.

    Raises `error` for pickled objects, for headers that say something else than the data, and for more than
    `MOST_ARRAY_BYTES`.
    """
    found = {}
    with open_untrusted(path, error) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                for member in archive.infolist():
                    name = member.filename.removesuffix(".npy")
                    if name in names:
                        found[name] = _array(archive, member, f"{path}: `{name}`", error)
        except (zipfile.BadZipFile, OSError, ValueError, EOFError, NotImplementedError, RuntimeError, MemoryError) as e:
            raise error(f"{path} is not an NPZ archive of arrays, or it is broken ({e})") from e
        except Exception as e:  # zlib.error, lzma.LZMAError, struct.error, tokenize.TokenError of a header
            if isinstance(e, DynamicsError):
                raise
            raise error(f"{path} is not an NPZ archive of arrays, or it is broken ({type(e).__name__})") from e
    return found


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, place: str, error: ErrorKind) -> np.ndarray:
    if member.file_size > MOST_ARRAY_BYTES:
        raise error(f"{place} has {_amount(member.file_size)}; at most {_amount(MOST_ARRAY_BYTES)} are read")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read_header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, fortran, dtype = read_header(stream, max_header_size=MOST_HEADER_CHARACTERS)
        if dtype.hasobject:
            raise error(f"{place} has Python objects; valid: numbers")
        wanted, there = math.prod(shape) * dtype.itemsize, member.file_size - stream.tell()
        if wanted != there:
            raise error(f"{place} says that it is {dtype} {shape}, {wanted} bytes, but has {there}")
        data = stream.read()
    order = "F" if fortran else "C"
    return np.frombuffer(data, dtype).reshape(shape, order=order)  # type: ignore[call-overload]


def read_table_bytes(path: Path, error: ErrorKind) -> io.BytesIO:
    """The bytes of a Parquet or CSV file, which are bounded; of Parquet, so are the rows and what they unpack to."""
    data = io.BytesIO(read_bytes(path, error, MOST_TABLE_BYTES))
    if path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            meta = pq.ParquetFile(data, thrift_string_size_limit=2**24, thrift_container_size_limit=2**20).metadata
            unpacked = sum(meta.row_group(k).total_byte_size for k in range(meta.num_row_groups))
        except (OSError, ValueError, pa.ArrowException) as problem:
            raise error(f"{path} cannot be read ({str(problem).splitlines()[0]})") from None
        if meta.num_rows > MOST_TABLE_ROWS or unpacked > MOST_TABLE_BYTES:
            raise error(f"{path} has {meta.num_rows:,} rows and unpacks to {_amount(unpacked)}; that is too much")
        data.seek(0)
    return data


def _amount(count: int) -> str:
    for unit, size in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count} bytes"
