"""The executor on Ray: the same bytes as on this machine, errors as there, and no result lost with a worker."""

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from toy_stage import drop_until_shard_2, make, make_weights

from pipeline.errors import ParamsError, ShardError, SimulationError
from pipeline.shards import ray_executor
from pipeline.shards.content_hash import hash_files
from pipeline.shards.ray_executor import HeadGoneError, RayExecutor, _check_address, _Head


@pytest.fixture(scope="module")
def cluster() -> Iterator[None]:
    """One local cluster for all tests, as starting one takes seconds."""
    pytest.importorskip("ray", reason='Ray is not installed: pip install -e ".[ray]"')
    with pytest.MonkeyPatch.context() as environment:
        environment.delenv("RAY_ADDRESS", raising=False)
        with RayExecutor(2, 1)._cluster():
            yield


@dataclass(frozen=True)
class Item:
    """times: how often the worker dies over it; folder: where that is counted."""

    name: str
    folder: Path
    times: int

    def __str__(self) -> str:
        return self.name


def die_sometimes(item: Item) -> tuple[str, str | None, str]:
    deaths = len(list(item.folder.glob(f"{item.name}-*")))
    if deaths < item.times:
        (item.folder / f"{item.name}-{deaths}").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item.name, os.environ.get("OMP_NUM_THREADS"), os.getcwd()


def test_ray_gives_the_bytes_of_this_machine_and_takes_what_is_in_the_store(
    cluster: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, executor in (("local", "local"), ("ray", "ray")):
        make(tmp_path / name, executor=executor)
        make_weights(tmp_path / name, executor=executor)
    for stage in ("drop", "weigh"):
        assert hash_files(tmp_path / "ray" / stage) == hash_files(tmp_path / "local" / stage)
    capsys.readouterr()
    make(tmp_path / "ray", clips=24, executor="ray")
    assert "6 shards, 1 computed, 5 from the store" in capsys.readouterr().out


def test_what_dies_with_its_worker_is_done_again_and_nothing_is_lost(cluster: None, tmp_path: Path) -> None:
    items = [Item(name, tmp_path, times) for name, times in (("a", 0), ("b", 1), ("c", 0))]
    done = sorted(RayExecutor(2, 1).map(die_sometimes, items))
    assert done == [(name, "1", os.getcwd()) for name in "abc"]


def test_what_always_dies_is_an_error_that_names_it(
    cluster: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ray_executor, "RETRIES", 0)
    with pytest.raises(ShardError, match=r"^b: its workers died 1 times"):
        list(RayExecutor(2, 1).map(die_sometimes, [Item("b", tmp_path, 9)]))


def test_what_raises_is_not_tried_again_and_leaves_what_was_done_in_the_store(
    cluster: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SimulationError, match="left the universe") as caught:
        make(tmp_path, executor="ray", compute=drop_until_shard_2, extra={"then": "raise"})
    assert any("in drop train, clips" in note for note in caught.value.__notes__)
    assert "drop_until_shard_2" in str(caught.value.__cause__)
    assert not (tmp_path / "drop").exists()


def test_without_ray_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ParamsError, match=r"pip install -e \"\.\[ray\]\""):
        list(RayExecutor(2, 1).map(die_sometimes, [Item("a", tmp_path, 0)]))


def test_an_address_where_nothing_answers_is_one_error_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for address in ("127.0.0.1:1", "ray://127.0.0.1:1", "nowhere"):
        monkeypatch.setenv("RAY_ADDRESS", address)
        with pytest.raises(ParamsError, match=rf"no Ray cluster can be reached \(RAY_ADDRESS={address}\)"):
            _check_address(address)


def test_a_head_is_gone_when_it_was_silent_for_long_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_executor, "CHECK_S", 0.01)
    monkeypatch.setattr(ray_executor, "GONE_S", 0.1)
    head = _Head("127.0.0.1:1")
    time.sleep(0.2)  # the process was busy with something else
    head.check()
    assert not head.gone
    time.sleep(0.2)
    with pytest.raises(HeadGoneError, match=r"127\.0\.0\.1:1.* has not answered"):
        head.check()
