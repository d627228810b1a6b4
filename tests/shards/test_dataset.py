"""Laws of reading a folder of shards."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from toy_stage import make

from pipeline.errors import ShardError
from pipeline.shards.dataset import ShardedDataset, open_shards


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make(tmp_path, clips=18)
    return tmp_path / "drop" / "train"


def test_access_by_index_gives_what_iterating_gives(folder: Path, rng: np.random.Generator) -> None:
    dataset = open_shards(folder)
    dataset.verify()
    clips = list(dataset)
    assert [clip.index for clip in clips] == list(range(18))
    for index in rng.permutation(18).tolist():
        assert dataset[index].row() == clips[index].row()
        np.testing.assert_array_equal(dataset[index].array("depth"), clips[index].array("depth"))
    assert dataset.table().column("clip").to_pylist() == list(range(18))


def test_a_clip_has_its_own_rows_and_no_others(folder: Path) -> None:
    for clip in open_shards(folder):
        rows = clip.rows("events")
        assert len(rows) == clip.index % 3
        assert all(row["clip"] == clip.index for row in rows)
        assert len(clip.array("depth")) == clip.index % 4


def test_a_view_of_fewer_clips_shows_these_alone(folder: Path) -> None:
    view = open_shards(folder).shards[1].narrowed(5, 7)
    assert list(view.clips) == [5, 6]
    assert view.table().column("clip").to_pylist() == [5, 6]
    with pytest.raises(IndexError, match="clip 4 is not in"):
        view.row(4)


@pytest.mark.parametrize("index", [-1, 18])
def test_a_clip_outside_is_an_index_error_that_says_what_is_there(folder: Path, index: int) -> None:
    with pytest.raises(IndexError, match="has the clips 0 to 17"):
        open_shards(folder)[index]


def test_the_error_of_an_unknown_name_lists_the_names(folder: Path) -> None:
    clip = open_shards(folder)[0]
    with pytest.raises(ShardError, match=r"no table `traces`; it has \['clips', 'events'\]"):
        clip.rows("traces")
    with pytest.raises(ShardError, match=r"no array `rgb`; it has \['depth', 'mask'\]"):
        clip.array("rgb")
    with pytest.raises(ShardError, match="clip 2 has 2 rows, not 1"):
        open_shards(folder)[2].row("events")


def test_the_error_of_a_folder_without_a_manifest_says_what_to_run(tmp_path: Path) -> None:
    with pytest.raises(ShardError, match=r"manifest.json is missing; run `dynamics store fsck"):
        open_shards(tmp_path / "data")
    (tmp_path / "manifest.json").write_text('{"stage": "drop"}')
    with pytest.raises(ShardError, match=r"manifest.json is damaged or not a manifest of shards"):
        open_shards(tmp_path)


READS: dict[str, tuple[str, Callable[[ShardedDataset], object]]] = {
    "table": ("shard-00001-of-00005.parquet", lambda dataset: dataset[5].row()),
    "array": ("shard-00001-of-00005.zarr/mask/c.0.0.0.0", lambda dataset: dataset[5].array("mask")),
    "array's description": ("shard-00001-of-00005.zarr/mask/zarr.json", lambda dataset: dataset[5].array("mask")),
    "all, by hash": ("shard-00001-of-00005.zarr/depth/c.0.0", lambda dataset: dataset.verify()),
}


@pytest.mark.parametrize("read", READS)
@pytest.mark.parametrize("state", ["missing", "damaged"])
def test_a_file_that_is_missing_or_damaged_is_named_with_what_to_run(folder: Path, read: str, state: str) -> None:
    name, access = READS[read]
    data = (folder / name).read_bytes()
    (folder / name).unlink()
    if state == "damaged":
        (folder / name).write_bytes(data[: len(data) // 2])
    with pytest.raises(ShardError) as caught:
        access(open_shards(folder))
    assert name.split("/c.")[0].removesuffix("/zarr.json") in str(caught.value)
    assert "dynamics store fsck" in str(caught.value)
