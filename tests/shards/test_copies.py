"""Mending from copies: in the store, in data/ and in DVC's cache."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import pytest
import toy_stage
from ruamel.yaml import YAML

from pipeline.commands.main import main as dynamics
from pipeline.shards.content_hash import hash_files
from pipeline.shards.copies import Copies
from pipeline.shards.dataset import open_shards
from pipeline.shards.store import Store


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository with an output, its store and DVC's cache as `dvc repro` leaves them: data/ and the cache share."""
    toy_stage.make(tmp_path, clips=8)
    (tmp_path / "data").mkdir()
    shutil.copytree(tmp_path / "drop", tmp_path / "data" / "drop")
    shutil.rmtree(tmp_path / "drop")
    output = tmp_path / "data" / "drop" / "train"
    rows = [{"md5": cache(tmp_path, output / name), "relpath": name} for name in hash_files(output)]
    listing = tmp_path / "listing"
    listing.write_text(json.dumps(rows))
    entry = {"cmd": "x", "outs": [{"path": "data/drop/train", "md5": f"{cache(tmp_path, listing, '.dir')}.dir"}]}
    YAML().dump({"stages": {"drop": entry}}, tmp_path / "dvc.lock")
    return tmp_path


def cache(root: Path, file: Path, suffix: str = "") -> str:
    md5 = hashlib.md5(file.read_bytes()).hexdigest()
    target = root / ".dvc/cache/files/md5" / md5[:2] / (md5[2:] + suffix)
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        os.link(file, target)
    return md5


def flip(path: Path) -> None:
    """Change the byte in the middle, in place, and nothing that a listing shows."""
    before = path.stat()
    path.chmod(0o644)
    with path.open("r+b") as file:
        file.seek(before.st_size // 2)
        byte = file.read(1)[0]
        file.seek(before.st_size // 2)
        file.write(bytes([byte ^ 4]))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    path.chmod(0o444)


def everything(root: Path) -> dict[str, str]:
    return {name: digest for name, digest in hash_files(root).items() if "/tmp/" not in name and "uses/" not in name}


@pytest.mark.parametrize("where", ["data/drop/train", "store", ".dvc/cache"])
def test_every_file_of_one_place_can_be_mended_from_the_others(root: Path, where: str) -> None:
    sound = everything(root)
    for name in hash_files(root / where):
        path = root / where / name
        if path.suffix in (".dir", ".lock") or path.name in ("shard.json", "manifest.json"):
            continue
        if b"drop" in path.read_bytes()[:60]:
            continue  # the manifest in the cache
        flip(path)
        mended, removed = Copies(root, Store(root / "store")).mend()
        assert path in mended
        assert removed == []
        assert everything(root) == sound


def test_what_has_no_sound_copy_is_removed_everywhere(root: Path) -> None:
    Copies(root, Store(root / "store")).link()
    table = root / "data/drop/train/shard-00000-of-00002.parquet"
    assert table.stat().st_nlink == 3
    flip(table)
    mended, removed = Copies(root, Store(root / "store")).mend()
    assert mended == []
    assert len([path for path in removed if path.is_relative_to(root / "data")]) == 1
    assert not table.exists()
    assert len(list(Store(root / "store").shards())) == 1


def test_the_record_of_a_shard_that_is_damaged_costs_that_shard_alone(root: Path) -> None:
    record = next((root / "store").glob("??/*/shard.json"))
    flip(record)
    _, removed = Copies(root, Store(root / "store")).mend()
    assert removed == [record.parent]


def test_the_command_mends_and_says_what(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DYNAMICS_STORE", str(root / "store"))
    monkeypatch.chdir(root)
    manifest, table = (root / "data/drop/train" / name for name in ("manifest.json", "shard-00000-of-00002.parquet"))
    text = manifest.read_text()
    manifest.unlink()  # no link to DVC's cache then
    manifest.write_text(text.replace("drop", "crop"))
    flip(table)
    assert dynamics(["store", "fsck"]) == 0
    out = capsys.readouterr().out
    assert "mended data/drop/train/manifest.json" in out
    assert "mended data/drop/train/shard-00000-of-00002.parquet" in out
    open_shards(root / "data/drop/train").verify()


def test_a_store_that_is_linked_takes_no_space_of_its_own(root: Path) -> None:
    sound = everything(root)
    copies = Copies(root, Store(root / "store"))
    assert copies.link() == sum(
        name.endswith((".parquet", "zarr.json")) or "/c." in name for name in hash_files(root / "store")
    )
    assert copies.link() == 0
    assert everything(root) == sound
