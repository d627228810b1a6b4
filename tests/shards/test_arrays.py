"""Laws of the Zarr shards."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.shards.arrays import open_arrays, write_arrays
from pipeline.shards.content_hash import hash_files


def random_arrays(rng: np.random.Generator) -> dict:
    return {
        "mask": rng.integers(0, 3, (6, 10, 20, 30), dtype=np.uint8),
        "flow": rng.normal(size=(6, 9, 20, 30, 2)).astype(np.float16),
        "valid": rng.random((6, 10)) < 0.5,
        "reward": rng.normal(size=6),
        "states": [rng.normal(size=(n, 13)) for n in (3, 0, 2, 5, 1, 1)],
    }


def test_reading_gives_what_was_written_clip_by_clip(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = random_arrays(rng)
    write_arrays(arrays, tmp_path / "a.zarr")
    group = open_arrays(tmp_path / "a.zarr")
    assert list(group) == sorted(arrays)
    for name, expected in arrays.items():
        assert len(group[name]) == 6
        for k in range(6):
            np.testing.assert_array_equal(group[name][k], expected[k])
            assert group[name][k].dtype == expected[0].dtype


def test_the_bytes_are_the_same_for_the_same_numbers_in_any_layout(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = random_arrays(rng)
    write_arrays(arrays, tmp_path / "a.zarr")
    other = dict(reversed(arrays.items()))
    other["mask"] = np.asfortranarray(other["mask"])
    other["reward"] = other["reward"].astype(">f8")
    write_arrays(other, tmp_path / "b.zarr")
    assert hash_files(tmp_path / "a.zarr") == hash_files(tmp_path / "b.zarr")


def test_a_shard_is_two_files_an_array(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = random_arrays(rng)
    write_arrays(arrays, tmp_path / "a.zarr")
    assert len(hash_files(tmp_path / "a.zarr")) == 1 + 2 * len(arrays)


def test_one_clip_is_read_without_the_others(tmp_path: Path, rng: np.random.Generator) -> None:
    clips = rng.integers(0, 256, (3, 5000), dtype=np.uint8)
    write_arrays({"noise": clips}, tmp_path / "a.zarr")
    file = tmp_path / "a.zarr" / "noise" / "c.0.0"
    data = file.read_bytes()
    file.write_bytes(bytes(4000) + data[4000:])  # inside the first clip
    noise = open_arrays(tmp_path / "a.zarr")["noise"]
    for k in (1, 2):
        np.testing.assert_array_equal(noise[k], clips[k])
    with pytest.raises(RuntimeError, match=r"[Zz]std"):
        noise[0]


@pytest.mark.parametrize("shape", [(1, 3), (4, 0), (0, 3)])
def test_arrays_without_numbers_keep_their_shape(tmp_path: Path, shape: tuple[int, int]) -> None:
    write_arrays({"x": np.zeros(shape)}, tmp_path / "a.zarr")
    x = open_arrays(tmp_path / "a.zarr")["x"]
    assert len(x) == shape[0]
    assert all(x[k].shape == shape[1:] for k in range(len(x)))


def test_words_are_refused_as_numbers(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="not a number"):
        write_arrays({"names": np.array(["a", "b"])}, tmp_path / "a.zarr")


def test_a_clip_outside_is_an_index_error(tmp_path: Path) -> None:
    write_arrays({"x": np.zeros((2, 3))}, tmp_path / "a.zarr")
    for k in (-1, 2):
        with pytest.raises(IndexError):
            open_arrays(tmp_path / "a.zarr")["x"][k]
