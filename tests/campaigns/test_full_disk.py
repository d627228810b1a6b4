"""A disk that is full: a small file system in memory, of sizes at which each write is once the one that fails."""

import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from campaign import no_hang, rounds
from toy_stage import make, make_weights

from pipeline.errors import OutputError
from pipeline.shards.content_hash import hash_files
from pipeline.shards.store import Store

pytestmark = pytest.mark.campaign

ENOUGH_KIB = 2000


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """An empty file system of ENOUGH_KIB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = ["mount", "-t", "tmpfs", "-o", f"size={ENOUGH_KIB}k", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mounted, capture_output=True).returncode:
        pytest.skip("a small file system can be mounted by root alone")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def resize(disk: Path, kib: int) -> None:
    subprocess.run(["mount", "-o", f"remount,size={kib}k", str(disk)], check=True)


def used_kib(disk: Path) -> int:
    state = os.statvfs(disk)
    return (state.f_blocks - state.f_bfree) * state.f_frsize // 1024


def test_a_full_disk_is_one_error_and_more_room_goes_on_to_the_undisturbed_bytes(
    tmp_path: Path, disk: Path, rng: np.random.Generator
) -> None:
    make(tmp_path / "sound", clips=12)
    make_weights(tmp_path / "sound")
    expected = {stage: hash_files(tmp_path / "sound" / stage) for stage in ("drop", "weigh")}
    root, counted = disk / "root", Counter[str]()
    for number in rounds(6, 150):
        room = int(rng.integers(8, 260)) if number else 8  # the first is never enough
        resize(disk, used_kib(disk) + room)
        try:
            with no_hang():
                make(root, clips=12)
                make_weights(root)
            counted["answers"] += 1
        except OutputError as error:
            counted["errors" if "no space is left" in str(error) else str(error)] += 1
        resize(disk, ENOUGH_KIB)
        for stage in ("drop", "weigh"):
            assert not (root / stage).exists() or hash_files(root / stage) == expected[stage], "half of an output"
        make(root, clips=12)
        make_weights(root)
        assert {stage: hash_files(root / stage) for stage in expected} == expected
        assert not list(Store(root / "store").temporary.iterdir())
        shutil.rmtree(root)
    print(dict(counted))
    assert counted["errors"] and set(counted) <= {"answers", "errors"}
