"""Laws of the store: complete or not there, sound or not used."""

import errno
import os
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import toy_stage
from toy_stage import make

from pipeline.commands.main import main as dynamics
from pipeline.errors import OutputError, ShardError
from pipeline.shards import output_folder
from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files
from pipeline.shards.prune import prune, usage
from pipeline.shards.store import Store, default_store

KEY = "ab" * 32


def put(text: str, notes: dict[str, int] | None = None) -> Callable[[Path], dict[str, int]]:
    """What writes a shard of one file with this text."""
    return lambda folder: ((folder / "clips.parquet").write_text(text) and notes) or {}


def files_under(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock"]


def test_what_was_committed_is_found_again(tmp_path: Path) -> None:
    committed = Store(tmp_path).commit(KEY, put("rows", {"rejected": 2}), {"parameters": {}})
    assert Store(tmp_path).lookup(KEY) == committed
    assert Store(tmp_path).lookup("cd" * 32) is None


def test_the_notes_of_a_shard_have_one_order_whoever_computed_it(tmp_path: Path) -> None:
    orders = {"a": {"rejected": 2, "drawn": 3}, "b": {"drawn": 3, "rejected": 2}}
    committed = [Store(tmp_path / name).commit(KEY, put("rows", notes), {}) for name, notes in orders.items()]
    found = Store(tmp_path / "a").lookup(KEY)
    assert found is not None
    assert [list(shard.notes) for shard in (*committed, found)] == [["drawn", "rejected"]] * 3


def test_the_same_shard_committed_twice_is_there_once(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first, second = (store.commit(KEY, put("rows"), {}) for _ in range(2))
    assert first == second == store.lookup(KEY)
    assert len(list(store.shards())) == 1
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "clips.parquet").unlink(), "clips.parquet is missing"),
        (lambda folder: (folder / "stray").touch(), "stray does not belong there"),
        (lambda folder: os.truncate(folder / "clips.parquet", 1), "the bytes of clips.parquet are not those"),
        (lambda folder: (folder / "shard.json").write_text("{"), "shard.json cannot be read"),
        (lambda folder: (folder / "shard.json").unlink(), "shard.json cannot be read"),
        (
            lambda folder: (folder / "shard.json").write_text(
                (folder / "shard.json").read_text().replace('"rejected": 2', '"rejected": 3')
            ),
            "shard.json was changed",
        ),
    ],
)
def test_a_damaged_shard_is_named_and_removed(
    tmp_path: Path, damage: Callable[[Path], None], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    store = Store(tmp_path)
    folder = store.commit(KEY, put("rows", {"rejected": 2}), {}).folder
    for path in folder.iterdir():
        path.chmod(0o644)
    damage(folder)
    assert store.lookup(KEY) is None
    (warning,) = capsys.readouterr().err.splitlines()
    assert str(folder) in warning
    assert message in warning
    assert not folder.exists()


@pytest.mark.parametrize(
    ("code", "message"),
    [(errno.ENOSPC, "no space is left"), (errno.EROFS, "read-only"), (errno.EACCES, "not permitted")],
)
def test_what_the_system_refuses_is_an_output_error_and_leaves_nothing(tmp_path: Path, code: int, message: str) -> None:
    def write_half(folder: Path) -> dict[str, int]:
        (folder / "clips.parquet").write_text("half")
        raise OSError(code, os.strerror(code))

    with pytest.raises(OutputError, match=f"cannot write to {tmp_path}: .*{message}"):
        Store(tmp_path).commit(KEY, write_half, {})
    assert files_under(tmp_path) == []


def test_a_disk_that_fills_while_placing_leaves_the_output_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path, clips=8)
    before = hash_files(tmp_path / "drop")

    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(output_folder, "place", full)
    with pytest.raises(OutputError, match=r"cannot write to .*train: no space is left on the disk"):
        make(tmp_path, clips=12)
    assert hash_files(tmp_path / "drop") == before


def run_toy(root: Path, setup: str) -> subprocess.CompletedProcess[str]:
    """The toy stage in a process in which it was run once elsewhere, and then `setup`."""
    environment = {
        **os.environ,
        "PYTHONPATH": f"{ROOT}:{Path(toy_stage.__file__).parent}",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    program = f"""
import os, resource, tempfile
from pathlib import Path
from stages.graph.run import run
from toy_stage import make
with tempfile.TemporaryDirectory() as elsewhere:
    make(Path(elsewhere), clips=4)
{setup}
run(lambda: make(Path({str(root)!r}), clips=4) and None, [])
"""
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, cwd="/")


def test_a_file_larger_than_allowed_is_one_error_with_exit_code_2(tmp_path: Path) -> None:
    done = run_toy(tmp_path, "resource.setrlimit(resource.RLIMIT_FSIZE, (700, 700))")
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"error: cannot write to {tmp_path}/store: the file would be larger")
    assert done.stderr.count("\n") == 1
    assert files_under(tmp_path) == []


@pytest.fixture
def everyones_folder() -> Iterator[Path]:
    """A folder that other users may enter, which pytest's are not."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


@pytest.mark.parametrize("place", ["store", "drop"])
def test_a_folder_one_may_not_write_to_is_one_error_with_exit_code_2(everyones_folder: Path, place: str) -> None:
    root = everyones_folder / "root"
    root.mkdir()
    (root / place).mkdir(mode=0o555)
    become_nobody = ""
    if os.geteuid() == 0:  # who may write everywhere
        if not all(folder.stat().st_mode & stat.S_IXOTH for folder in ROOT.parents):
            pytest.skip(f"root runs this test as another user, who may not read {ROOT}")
        nobody = 65534
        os.chown(root, nobody, nobody)
        become_nobody = f"os.setegid({nobody}); os.seteuid({nobody})"
    done = run_toy(root, become_nobody)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"error: cannot write to {root / place}")
    assert ": writing is not permitted" in done.stderr
    assert files_under(root / place) == []


def test_the_store_s_place_is_the_environment_s_or_the_repository_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "dvc.yaml").touch()
    monkeypatch.chdir(tmp_path / "a" / "b")
    monkeypatch.delenv("DYNAMICS_STORE", raising=False)
    assert default_store().folder == tmp_path / ".shards"
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "elsewhere"))
    assert default_store().folder == tmp_path / "elsewhere"


def test_pruning_by_days_keeps_what_was_used_lately(tmp_path: Path) -> None:
    store = Store(tmp_path)
    old, new = (store.commit(key * 32, put("rows"), {}) for key in ("ab", "cd"))
    os.utime(old.folder, (0, 0))
    assert prune(store, keep_days=30).shards == 1
    assert list(store.shards()) == [new.folder]


def test_pruning_by_size_keeps_the_last_used_that_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path))
    store = Store(tmp_path)
    shards = [store.commit(key * 32, put("x" * 1000), {}) for key in ("ab", "cd", "ef")]
    for age, shard in enumerate(shards):
        os.utime(shard.folder, (1000 - age, 1000 - age))
    assert dynamics(["store", "prune", "--keep-gib", str(3000 / 2**30)]) == 0
    assert list(store.shards()) == [shards[0].folder, shards[1].folder]
    assert "removed 1 shards" in capsys.readouterr().out
    assert dynamics(["store", "info"]) == 0
    assert "2 shards" in capsys.readouterr().out
    assert dynamics(["store", "prune"]) == 2
    assert "give --keep-days or --keep-gib" in capsys.readouterr().err


def test_a_use_counts_for_pruning(tmp_path: Path) -> None:
    store = Store(tmp_path)
    os.utime(store.commit(KEY, put("rows"), {}).folder, (0, 0))
    store.lookup(KEY)
    assert prune(store, keep_days=30).shards == 0


def test_what_a_run_uses_is_not_pruned_before_it_ends(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.commit(KEY, put("rows"), {})
    with store.using([KEY, "cd" * 32]):
        assert prune(store, keep_bytes=0).shards == 0
        assert store.lookup(KEY) is not None
    assert prune(store, keep_bytes=0).shards == 1


def test_what_a_killed_run_used_and_wrote_is_pruned(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.commit(KEY, put("rows"), {})
    program = f"""
import os
from pathlib import Path
from pipeline.shards.store import Store
store = Store(Path({str(tmp_path)!r}))
def write(folder):
    (folder / "clips.parquet").write_text("x" * 10000)
    os.kill(os.getpid(), 9)
with store.using([{KEY!r}]):
    store.commit("cd" * 32, write, {{}})
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    assert subprocess.run([sys.executable, "-c", program], env=environment).returncode == -9
    assert usage(store).temporary_bytes == 10000
    removed = prune(store, keep_bytes=0)
    assert (removed.shards, removed.temporary_bytes) == (1, 10000)
    assert usage(store).bytes == 0


def test_a_writer_s_folder_is_left_alone_whatever_its_process_id_means_here(tmp_path: Path) -> None:
    """In a container of its own, another process may have any id, and the same host name."""
    store = Store(tmp_path)

    def write(folder: Path) -> dict[str, int]:
        (folder / "clips.parquet").write_text("rows")
        Store(tmp_path).check_writable()  # what another process calls, and what sweeps
        return {}

    assert list(store.commit(KEY, write, {}).files) == ["clips.parquet"]


def test_other_bytes_under_a_key_are_an_error_and_change_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first = store.commit(KEY, put("rows"), {})
    with pytest.raises(ShardError, match=r"computed a second time with another result \(clips.parquet\)"):
        store.commit(KEY, put("other rows"), {})
    assert store.lookup(KEY) == first


def test_a_damaged_shard_is_replaced_by_one_that_is_computed_meanwhile(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first = store.commit(KEY, put("rows"), {})
    (first.folder / "clips.parquet").chmod(0o644)
    (first.folder / "clips.parquet").write_text("flip")
    assert store.commit(KEY, put("rows"), {}) == first
    assert store.lookup(KEY) == first


def test_a_clock_that_was_set_back_changes_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path / "sound", clips=12)
    make(tmp_path / "early", clips=8)
    in_a_year = time.time() + 365 * 24 * 3600
    for path in (tmp_path / "early").rglob("*"):  # as they look after the clock was set back
        os.utime(path, (in_a_year, in_a_year), follow_symlinks=False)
    capsys.readouterr()
    make(tmp_path / "early", clips=12)
    assert "3 shards, 1 computed, 2 from the store" in capsys.readouterr().out
    assert hash_files(tmp_path / "early" / "drop") == hash_files(tmp_path / "sound" / "drop")
    store = Store(tmp_path / "early" / "store")
    assert prune(store, keep_days=1).shards == 0
    prune(store, keep_bytes=0)
    make(tmp_path / "early", clips=12)
    assert hash_files(tmp_path / "early" / "drop") == hash_files(tmp_path / "sound" / "drop")
