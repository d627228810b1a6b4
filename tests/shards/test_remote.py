"""A store on an S3 server (moto's, in a process of its own)."""

import os
import shutil
from pathlib import Path

import pytest
from s3_server import S3Server
from toy_stage import Drop, drop, drop_until_shard_2, make

from pipeline.errors import OutputError, ParamsError, ShardError, SimulationError
from pipeline.shards import remote as remote_module
from pipeline.shards.content_hash import hash_files
from pipeline.shards.map_shards import map_shards
from pipeline.shards.remote import Remote
from pipeline.shards.store import Store, default_store

KEY = "ab" * 32


@pytest.fixture
def account(server: S3Server, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def remote(account: None, request: pytest.FixtureRequest) -> Remote:
    return Remote(f"s3://bucket/{abs(hash(request.node.name))}")


def write(folder: Path) -> dict[str, int]:
    (folder / "deep").mkdir()
    (folder / "deep" / "a").write_text("a")
    (folder / "b").write_text("b")
    return {"rows": 2}


def objects(remote: Remote) -> list[str]:
    return sorted(remote._fs.find(remote.url.removeprefix("s3://")))


def test_what_one_machine_commits_another_finds_whole(tmp_path: Path, remote: Remote) -> None:
    one, other = (Store(tmp_path / name, remote) for name in ("one", "other"))
    committed = one.commit(KEY, write, {})
    found = other.lookup(KEY)
    assert found is not None
    assert (found.files, found.notes, found.content) == (committed.files, committed.notes, committed.content)
    assert hash_files(found.folder) == hash_files(committed.folder)
    assert other.lookup("cd" * 32) is None


def test_a_shard_without_its_last_object_is_not_there(tmp_path: Path, remote: Remote) -> None:
    Store(tmp_path / "one", remote).commit(KEY, write, {})
    remote._fs.rm_file(next(path for path in objects(remote) if path.endswith("shard.json")))
    assert Store(tmp_path / "other", remote).lookup(KEY) is None


def test_a_damaged_object_is_noticed_and_replaced_by_the_next_who_computes(
    tmp_path: Path, remote: Remote, capsys: pytest.CaptureFixture[str]
) -> None:
    Store(tmp_path / "one", remote).commit(KEY, write, {})
    victim = next(path for path in objects(remote) if not path.endswith("shard.json"))
    remote._fs.pipe_file(victim, b"flipped")
    other = Store(tmp_path / "other", remote)
    assert other.lookup(KEY) is None
    assert "it is damaged; it is computed again" in capsys.readouterr().err
    other.commit(KEY, write, {})
    assert Store(tmp_path / "third", remote).lookup(KEY) is not None


def test_other_bytes_under_a_key_are_an_error_and_the_first_stay(tmp_path: Path, remote: Remote) -> None:
    first = Store(tmp_path / "one", remote).commit(KEY, write, {})

    def write_other(folder: Path) -> dict[str, int]:
        (folder / "b").write_text("other")
        return {"rows": 2}

    with pytest.raises(ShardError, match="another result"):
        Store(tmp_path / "other", remote).commit(KEY, write_other, {})
    found = Store(tmp_path / "third", remote).lookup(KEY)
    assert found is not None
    assert found.files == first.files


def test_a_damaged_cache_is_mended_from_the_server(tmp_path: Path, remote: Remote) -> None:
    store = Store(tmp_path / "one", remote)
    folder = store.commit(KEY, write, {}).folder
    (folder / "b").chmod(0o644)
    (folder / "b").write_text("flipped")
    found = store.lookup(KEY)
    assert found is not None
    assert (found.folder / "b").read_text() == "b"


def test_what_was_committed_and_not_published_is_published_by_the_next_run(tmp_path: Path, remote: Remote) -> None:
    Store(tmp_path / "one").commit(KEY, write, {})  # as a kill in between leaves it
    assert Store(tmp_path / "one", remote).lookup(KEY) is not None
    assert Store(tmp_path / "other", remote).lookup(KEY) is not None


def test_a_second_machine_computes_nothing(tmp_path: Path, remote: Remote, capsys: pytest.CaptureFixture[str]) -> None:
    def run(root: Path, compute=drop, **extra: object) -> None:
        store = Store(root / "cache", remote)
        parameters = Drop(1, **extra)  # type: ignore[arg-type]
        map_shards(
            "drop",
            "train",
            root / "out",
            compute,
            parameters=parameters,
            clips=12,
            shard_size=4,
            workers=1,
            store=store,
        )

    with pytest.raises(SimulationError):  # the first two shards are done
        run(tmp_path / "one", drop_until_shard_2, then="raise")
    run(tmp_path / "one")
    run(tmp_path / "two")
    assert "3 shards, 0 computed, 3 from the store" in capsys.readouterr().out
    assert hash_files(tmp_path / "one" / "out") == hash_files(tmp_path / "two" / "out")
    make(tmp_path / "local", clips=12)
    assert hash_files(tmp_path / "local" / "drop" / "train") == hash_files(tmp_path / "one" / "out")


def test_a_server_that_is_gone_is_waited_for_and_then_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, remote: Remote
) -> None:
    class Gone:
        asked = 0

        def cat_file(self, path: str) -> bytes:
            self.asked += 1
            if self.asked < 3:
                raise ConnectionError("gone")
            raise FileNotFoundError(path)

    gone = Gone()
    monkeypatch.setattr(remote_module, "_FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(remote_module, "_file_system", lambda url: (gone, "bucket"))
    assert remote.record(KEY) is None
    assert gone.asked == 3
    monkeypatch.setattr(remote_module, "PATIENCE_S", 0.0)
    gone.asked = 0
    with pytest.raises(OutputError, match=r"s3://bucket/.* could not be reached for 0 s: gone"):
        remote.record(KEY)


def test_a_bucket_that_is_not_there_is_one_error(tmp_path: Path, account: None) -> None:
    with pytest.raises(OutputError, match="cannot write to s3://nobucket/x"):
        Store(tmp_path, Remote("s3://nobucket/x")).commit(KEY, write, {})


def test_the_environment_names_a_folder_a_file_url_or_a_remote_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DYNAMICS_CACHE", str(tmp_path / "cache"))
    for place, folder, url in (
        (str(tmp_path / "a"), tmp_path / "a", None),
        (f"file://{tmp_path}/a", tmp_path / "a", None),
        ("s3://bucket/a", tmp_path / "cache", "s3://bucket/a"),
    ):
        monkeypatch.setenv("DYNAMICS_STORE", place)
        store = default_store()
        assert store.folder == folder
        assert (store.remote and store.remote.url) == url
    with pytest.raises(ParamsError, match="nosuch://x is no place for a store"):
        Remote("nosuch://x").record(KEY)


def test_without_the_extra_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import fsspec

    def missing(url: str, **_: object) -> None:
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr(fsspec.core, "url_to_fs", missing)
    with pytest.raises(ParamsError, match=r"pip install -e \"\.\[s3\]\""):
        Remote(f"s3://bucket/{os.getpid()}").record(KEY)


def test_data_that_is_lost_comes_back_from_the_server(tmp_path: Path, remote: Remote) -> None:
    store = Store(tmp_path / "one", remote)
    store.commit(KEY, write, {})
    shutil.rmtree(tmp_path / "one")
    assert store.lookup(KEY) is not None
