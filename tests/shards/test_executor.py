"""Laws of the executors."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from toy_stage import make

from pipeline.errors import ParamsError
from pipeline.shards.content_hash import hash_files
from pipeline.shards.executor import EXECUTORS, RANK, WORLD_SIZE, LocalExecutor, SliceFinished, make_executor


@dataclass(frozen=True)
class Item:
    """name: of the file that it leaves in `folder` when it is done; after: the item that has to be done before."""

    name: str
    folder: Path
    after: str | None = None


def leave_a_file(item: Item) -> tuple[str, int]:
    """The item's name and the process, once the item that it waits for is done (or a minute is over)."""
    for _ in range(6000):
        if item.after is None or (item.folder / item.after).exists():
            break
        time.sleep(0.01)
    (item.folder / item.name).touch()
    return item.name, os.getpid()


def threads_of_worker(_: int) -> set[str | None]:
    return {os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")}


def fail_strangely(_: int) -> None:
    class Unpicklable(Exception):
        def __reduce__(self) -> tuple:
            raise TypeError("no")

    raise Unpicklable("cannot travel")


@pytest.fixture(autouse=True)
def no_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (RANK, WORLD_SIZE):
        monkeypatch.delenv(name, raising=False)


def test_results_come_in_the_order_of_completion_from_other_processes(tmp_path: Path) -> None:
    items = [Item("a", tmp_path, after="c"), Item("b", tmp_path), Item("c", tmp_path)]
    done = list(LocalExecutor(workers=2, threads=1).map(leave_a_file, items))
    assert [name for name, _ in done] == ["b", "c", "a"]
    assert os.getpid() not in {process for _, process in done}


@pytest.mark.parametrize(("workers", "names"), [(1, "ab"), (2, "a")])
def test_one_worker_or_one_item_needs_no_process(tmp_path: Path, workers: int, names: str) -> None:
    done = list(LocalExecutor(workers, 1).map(leave_a_file, [Item(name, tmp_path) for name in names]))
    assert done == [(name, os.getpid()) for name in names]


def test_a_worker_has_the_threads_it_is_given_and_this_process_keeps_its_own() -> None:
    before = dict(os.environ)
    assert list(LocalExecutor(workers=2, threads=3).map(threads_of_worker, [1, 2])) == [{"3"}, {"3"}]
    assert dict(os.environ) == before


def test_an_error_that_cannot_be_pickled_is_described_with_its_traceback() -> None:
    with pytest.raises(RuntimeError, match="Unpicklable: cannot travel") as caught:
        list(LocalExecutor(workers=2, threads=1).map(fail_strangely, [1, 2]))
    assert "in fail_strangely" in str(caught.value.__cause__)


def test_an_executor_that_is_unknown_or_not_there_yet_is_an_error_that_says_what_is() -> None:
    with pytest.raises(ParamsError, match="`slurm` is unknown; valid: local, ray, slice"):
        make_executor("slurm", 1)
    with pytest.raises(ParamsError, match="`ray` comes with a later release"):
        make_executor("ray", 1)
    with pytest.raises(ParamsError, match="at least 1"):
        make_executor("local", 0)


@pytest.mark.parametrize(
    ("rank", "world", "message"),
    [
        ("4", "4", "must be 0 to 3"),
        ("-1", "4", "must be 0 to 3"),
        ("a", "4", "whole numbers"),
        ("1", None, "go together"),
    ],
)
def test_a_rank_outside_of_the_world_is_refused(
    monkeypatch: pytest.MonkeyPatch, rank: str, world: str | None, message: str
) -> None:
    monkeypatch.setenv(RANK, rank)
    if world is not None:
        monkeypatch.setenv(WORLD_SIZE, world)
    with pytest.raises(ParamsError, match=message):
        make_executor("local", 1)


def test_slices_share_the_items_without_gap_or_overlap(rng: np.random.Generator) -> None:
    items, world = list(range(int(rng.integers(20)))), int(rng.integers(1, 6))
    shares = []
    for rank in range(world):
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv(RANK, str(rank))
            environment.setenv(WORLD_SIZE, str(world))
            shares += make_executor("local", 1).share(items)
    assert sorted(shares) == items


def test_the_slices_of_a_batch_job_and_a_last_call_give_what_one_call_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path / "one")
    for rank, count in ((0, 3), (1, 2)):
        monkeypatch.setenv(RANK, str(rank))
        monkeypatch.setenv(WORLD_SIZE, "2")
        with pytest.raises(SliceFinished, match=f"{count} shards, {count} computed, 0 .* a last call without") as done:
            make(tmp_path / "two")
        assert str(tmp_path / "two" / "store") in str(done.value)
    assert not (tmp_path / "two" / "drop").exists()
    monkeypatch.delenv(RANK)
    monkeypatch.delenv(WORLD_SIZE)
    capsys.readouterr()
    make(tmp_path / "two")
    assert "5 shards, 0 computed, 5 from the store" in capsys.readouterr().out
    assert hash_files(tmp_path / "two" / "drop") == hash_files(tmp_path / "one" / "drop")


def test_every_executor_of_the_table_has_a_name_that_params_allows() -> None:
    from stages.graph.params import ExecutorSettings

    for name in EXECUTORS:
        assert ExecutorSettings(name=name, workers=None).name == name
