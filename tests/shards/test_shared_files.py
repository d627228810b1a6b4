"""Files that tasks read by path, on a machine that lacks them or has others there."""

from pathlib import Path

import pytest

from pipeline.shards.content_hash import hash_path
from pipeline.shards.shared_files import file_key, place_file, share_file
from pipeline.shards.store import Store


@pytest.mark.parametrize("name", ["model", "weights.bin"])
def test_a_file_or_folder_comes_as_it_was_wherever_it_is_missing_or_another(tmp_path: Path, name: str) -> None:
    source, store = tmp_path / "here" / name, Store(tmp_path / "store")
    if "." in name:
        source.parent.mkdir()
        source.write_text("weights")
    else:
        (source / "deep").mkdir(parents=True)
        (source / "deep" / "weights").write_text("weights")
        (source / "config").write_text("config")
    key = file_key(source)
    share_file(store, source, key)
    share_file(store, source, key)
    target = tmp_path / "there" / name
    for _ in range(2):
        place_file(store, target, key)
        assert hash_path(target) == hash_path(source)
    changed = target if target.is_file() else target / "config"
    changed.unlink()
    changed.write_text("stale")
    place_file(store, target, key)
    assert hash_path(target) == hash_path(source)
    assert [path.name for path in target.parent.iterdir()] == [name]
