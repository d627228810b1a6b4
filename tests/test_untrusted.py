"""What a user's file cannot do: run a program, fill the memory, wait without end, or show a traceback."""

import io
import os
import struct
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline import untrusted
from pipeline.errors import SceneError, VideoError
from pipeline.scene.text import load_scene, read_scene
from pipeline.untrusted import open_png, parse_xml, parse_yaml, read_bytes, read_json, read_npz, read_table_bytes

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefghi", "bcdefghij", strict=True)
)


def fifo(path: Path) -> None:
    os.mkfifo(path)


def huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**40)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (fifo, "is a pipe or a device"),
        (Path.mkdir, "is a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "is a pipe or a device"),
        (lambda path: path.symlink_to(path), "cannot be read: Too many levels"),
        (lambda path: None, "there is no such file"),
        (huge, "at most 1 MiB are read"),
    ],
)
def test_what_is_no_bounded_file_is_one_error_at_once(
    tmp_path: Path, make: Callable[[Path], None], message: str
) -> None:
    make(tmp_path / "input")
    began = time.monotonic()
    with pytest.raises(SceneError, match=message):
        load_scene(tmp_path / "input")
    assert time.monotonic() - began < 1


def test_a_file_that_is_longer_than_it_says_is_not_read_to_its_end() -> None:
    assert os.stat("/proc/self/maps").st_size == 0
    with pytest.raises(SceneError, match="has more than 100 bytes"):
        read_bytes(Path("/proc/self/maps"), SceneError, 100)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "aliases"),
        ("&a [*a]", "aliases"),
        ("[" * 5000, "more than 40 levels"),
        ("- " * 5000, "more than 40 levels"),
        ("!!python/object/apply:os.system [id]", "could not determine a constructor"),
        ("a: " + "1" * 5000, "not YAML"),
        ("? [a]\n: b", "a list is the key"),
        ("a: " + "1" * 400, "a number of 400 digits"),
        ("!!binary aGk=", "of the kind bytes"),
        ("a: 'b", "not YAML at line 1"),
        ("x" * (2**20 + 1), "more than 1 MiB"),
        ("\x00", "not YAML"),
    ],
)
def test_yaml_that_grows_nests_or_calls_is_one_error_of_one_line(text: str, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        read_scene(text)
    assert "\n" not in str(caught.value)


def test_yaml_of_plain_values_is_what_it_says() -> None:
    assert parse_yaml("a: [1, 2.5, on, 1e-5]", "x", SceneError) == {"a": [1, 2.5, "on", 1e-5]}


def png(width: int, height: int) -> bytes:
    """A PNG that says so much of its size and has no pixels."""
    with io.BytesIO() as file:
        Image.new("L", (1, 1)).save(file, "PNG")
        data = file.getvalue()
    header = b"IHDR" + struct.pack(">II", width, height) + data[24:29]
    import zlib

    return data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 8\n(/tmp/x) run\n", "is not a PNG picture"),
        (b"GIF89a\x01\x00\x01\x00\x00\x00\x00;", "is not a PNG picture"),
        (png(40_000, 40_000), "too many pixels; at most"),
        (png(10_000, 10_000), "10000 x 10000 px; at most"),
        (png(7_000, 7_000), "is not a PNG picture, or it is broken"),
        (b"", "is not a PNG picture"),
    ],
)
def test_a_picture_is_a_png_of_bounded_size_whatever_its_name(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "000.png").write_bytes(data)
    with pytest.raises(VideoError, match=message), open_png(tmp_path / "000.png", VideoError):
        pass


def npz(path: Path, header: bytes, data: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("masks.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data)
    return path


def header(descr: str, shape: str) -> bytes:
    return f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}\n".encode()


@pytest.mark.parametrize(
    ("descr", "shape", "message"),
    [
        ("'|u1'", "(1000000, 1000000, 1000000)", "says that it is uint8"),
        ("'|u1'", "(-4,)", "says that it is|not an NPZ"),
        ("'|O'", "(4,)", "has Python objects"),
        ("__import__('os').system('id')", "(4,)", "not an NPZ"),
        ("'|u1'", "(" * 3000, "not an NPZ"),
    ],
)
def test_the_header_of_an_array_is_checked_against_its_data(
    tmp_path: Path, descr: str, shape: str, message: str
) -> None:
    path = npz(tmp_path / "masks.npz", header(descr, shape), b"\x00" * 4)
    with pytest.raises(VideoError, match=message):
        read_npz(path, ("masks",), VideoError)


def test_an_array_that_unpacks_to_more_than_is_allowed_is_not_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(untrusted, "MOST_ARRAY_BYTES", 2**20)
    np.savez_compressed(tmp_path / "masks.npz", masks=np.zeros((16, 512, 512), np.uint8))
    assert (tmp_path / "masks.npz").stat().st_size < 10_000
    with pytest.raises(VideoError, match=r"has 4 MiB; at most 1 MiB are read"):
        read_npz(tmp_path / "masks.npz", ("masks",), VideoError)


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_sound_array_is_what_was_written(tmp_path: Path, order: str) -> None:
    masks = np.asarray(np.arange(24).reshape(2, 3, 4), order=order)  # type: ignore[call-overload]
    np.savez(tmp_path / "masks.npz", masks=masks, other=np.array([{}], object))
    assert (read_npz(tmp_path / "masks.npz", ("masks",), VideoError)["masks"] == masks).all()


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "{", '{"a": NaN'])
def test_json_that_is_no_object_is_one_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SceneError, match=r"a.json is not"):
        read_json(tmp_path / "a.json", SceneError)


def test_a_table_that_unpacks_to_more_than_is_allowed_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pandas as pd

    pd.DataFrame({"x": np.zeros(100_000)}).to_parquet(tmp_path / "t.parquet")
    assert read_table_bytes(tmp_path / "t.parquet", SceneError).read(4) == b"PAR1"
    monkeypatch.setattr(untrusted, "MOST_TABLE_ROWS", 99_999)
    with pytest.raises(SceneError, match="100,000 rows"):
        read_table_bytes(tmp_path / "t.parquet", SceneError)


MESH = """
camera: null
gravity: 9.81
ground: null
objects:
- {shape: mesh, file: FILE, scale: 1.0, mass: 1.0, sliding_friction: 0.5, rolling_friction: 0.0, damping: 1.0,
   position: [0, 0, 0], velocity: [0, 0, 0], angular_velocity: [0, 0, 0], orientation: [1, 0, 0, 0]}
"""


@pytest.mark.parametrize("file", ["/etc/passwd", "../secret.stl", "inside/../../secret.stl", "link.stl"])
def test_a_mesh_file_outside_of_the_scene_s_folder_is_refused(tmp_path: Path, file: str) -> None:
    (tmp_path / "secret.stl").touch()
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "link.stl").symlink_to(tmp_path / "secret.stl")
    (folder / "scene.yaml").write_text(MESH.replace("FILE", file))
    with pytest.raises(SceneError, match=r"objects\[0\].file: .* is outside of the scene's folder"):
        load_scene(folder / "scene.yaml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_of_xml_are_refused_in_every_encoding_and_words_about_them_are_not(encoding: str) -> None:
    begin = f'<?xml version="1.0" encoding="{encoding}"?>'
    entities = f'{begin}<!DOCTYPE x [<!ENTITY a "{1000 * "b"}"><!ENTITY c "{1000 * "&a;"}">]><x>{1000 * "&c;"}</x>'
    with pytest.raises(SceneError, match=r"robot.xml: .*entities are not allowed"):
        parse_xml(entities.encode(encoding), "robot.xml", SceneError)
    text = f"{begin}<x><!-- <!DOCTYPE x> --><y>1</y></x>"
    assert parse_xml(text.encode(encoding), "robot.xml", SceneError).findtext("y") == "1"


@pytest.mark.parametrize("data", [b"", b"<x>", b"\xff\xfe<", b'<?xml version="1.0" encoding="none"?><x/>'])
def test_what_is_no_xml_is_one_error(data: bytes) -> None:
    with pytest.raises(SceneError, match=r"^robot.xml: not XML") as error:
        parse_xml(data, "robot.xml", SceneError)
    assert "\n" not in str(error.value)
