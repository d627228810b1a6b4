"""Laws of the executors."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from pipeline.errors import ParamsError
from pipeline.shards.executor import EXECUTORS, LocalExecutor, make_executor


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


def test_results_come_in_the_order_of_completion_from_other_processes(tmp_path: Path) -> None:
    items = [Item("a", tmp_path, after="go on"), Item("b", tmp_path), Item("c", tmp_path)]
    results = LocalExecutor(workers=2, threads=1).map(leave_a_file, items)
    done = [next(results), next(results)]
    (tmp_path / "go on").touch()
    done += results
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


def test_an_executor_that_is_unknown_is_an_error_that_says_what_is() -> None:
    with pytest.raises(ParamsError, match="`slurm` is unknown; valid: local, ray"):
        make_executor("slurm", 1)
    with pytest.raises(ParamsError, match="at least 1"):
        make_executor("local", 0)


def test_every_executor_of_the_table_has_a_name_that_params_allows() -> None:
    from stages.graph.params import ExecutorSettings

    for name in EXECUTORS:
        assert ExecutorSettings(name=name, workers=None).name == name
