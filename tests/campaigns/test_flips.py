"""Flipped, cut and swapped bytes in every kind of file of the store and of data/: noticed, and made again or mended."""

import json
import os
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from campaign import damaged, no_hang, rounds
from toy_stage import make, make_weights

from pipeline.errors import ShardError
from pipeline.shards.content_hash import hash_files
from pipeline.shards.dataset import open_shards

pytestmark = pytest.mark.campaign


def damage(path: Path, rng: np.random.Generator) -> None:
    """Change a file in place, with the times that it had, until its bytes differ."""
    before, data = path.stat(), path.read_bytes()
    while (changed := damaged(data, rng)) == data:
        pass
    path.chmod(0o644)
    path.write_bytes(changed)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def separate(root: Path) -> None:
    """Make the output files of their own, no links to the store."""
    copy = root.with_name("copy")
    shutil.copytree(root / "drop", copy)
    shutil.rmtree(root / "drop")
    shutil.move(copy, root / "drop")


def same_json(path: Path, sound: bytes) -> bool:
    """Whether the damage met white space of a JSON text."""
    try:
        return path.name in ("manifest.json", "shard.json") and json.loads(path.read_bytes()) == json.loads(sound)
    except ValueError:
        return False


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")


def test_a_damaged_file_of_the_store_is_never_used(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, clips=8)
    expected = hash_files(tmp_path / "drop")
    for _ in rounds(15, 700):
        victim = rng.choice(np.array(files_of(tmp_path / "store"), object))
        sound = victim.read_bytes()
        damage(victim, rng)
        noticed = not same_json(victim, sound)
        shutil.rmtree(tmp_path / "drop")
        with no_hang():
            make(tmp_path, clips=8)
        assert hash_files(tmp_path / "drop") == expected
        assert noticed == ("is damaged" in capsys.readouterr().err), f"{victim}: {sound!r}"


def test_a_damaged_file_of_data_is_an_error_for_who_reads_it(tmp_path: Path, rng: np.random.Generator) -> None:
    make(tmp_path, clips=8)
    separate(tmp_path)
    folder = tmp_path / "drop" / "train"
    expected = [(clip.row(), clip.rows("events"), clip.array("mask").tobytes()) for clip in open_shards(folder)]
    counted: Counter[str] = Counter()
    for _ in rounds(30, 1000):
        victim = rng.choice(np.array(files_of(folder), object))
        sound = victim.read_bytes()
        damage(victim, rng)
        with no_hang():
            try:
                read = [(clip.row(), clip.rows("events"), clip.array("mask").tobytes()) for clip in open_shards(folder)]
            except ShardError:
                counted["errors"] += 1
            else:
                assert read == expected, f"{victim}: other rows, without an error"
                assert "depth" in str(victim) or same_json(victim, sound), f"{victim} was read"
                counted["not read"] += 1
        if not same_json(victim, sound):
            with pytest.raises(ShardError):
                open_shards(folder).verify()
        victim.chmod(0o644)
        victim.write_bytes(sound)
        os.utime(victim)  # noticed as another version
    print(dict(counted))
    assert counted["errors"]


def test_damaged_input_never_reaches_the_store(tmp_path: Path, rng: np.random.Generator) -> None:
    make(tmp_path, clips=8)
    make_weights(tmp_path)
    expected = hash_files(tmp_path / "weigh")
    separate(tmp_path)
    for _ in rounds(5, 200):
        victim = rng.choice(np.array(files_of(tmp_path / "drop"), object))
        sound = victim.read_bytes()
        damage(victim, rng)
        shutil.rmtree(tmp_path / "store", ignore_errors=True)
        if not same_json(victim, sound):
            with pytest.raises(ShardError), no_hang():
                make_weights(tmp_path)
        assert hash_files(tmp_path / "weigh") == expected
        victim.chmod(0o644)
        victim.write_bytes(sound)
        os.utime(victim)
