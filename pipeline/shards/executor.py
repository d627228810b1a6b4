"""Where the shards are computed: on this machine, or on those of a Ray cluster."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pipeline.errors import ParamsError
from pipeline.shards.numeric_threads import threads_here
from pipeline.shards.ray_executor import RayExecutor
from pipeline.shards.worker_pool import map_in_processes

Item = TypeVar("Item")
Result = TypeVar("Result")


class Executor(Protocol):
    """What `map_shards` needs of an executor; `EXECUTORS` lists them."""

    @property
    def distant(self) -> bool:
        """Whether the items may be worked on by machines that have the code and the store, and no data/."""

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Apply a picklable function to picklable items; results in the order of completion."""


@dataclass(frozen=True)
class LocalExecutor:
    """Spawned processes on this machine; this process itself where there is one worker or one item."""

    workers: int
    threads: int
    distant = False

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        if self.workers > 1 and len(items) > 1:
            yield from map_in_processes(function, items, self.workers, self.threads)
            return
        for item in items:
            with threads_here(self.threads):
                try:
                    result = function(item)
                except Exception as error:
                    error.add_note(f"in {item}")
                    raise
            yield result


def _local(workers: int | None, threads: int) -> Executor:
    return LocalExecutor(workers or max(1, len(os.sched_getaffinity(0)) // threads), threads)


EXECUTORS: dict[str, Callable[[int | None, int], Executor]] = {"local": _local, "ray": RayExecutor}


def make_executor(name: str, workers: int | None, threads: int = 1) -> Executor:
    """The executor of that name.

    Args:
        name: A key of `EXECUTORS`.
        workers: How many items are worked on at a time; None: one per core.
        threads: Numeric threads of each.

    Raises:
        ParamsError: The name is unknown, or the number of workers is impossible.
    """
    if workers is not None and workers < 1:
        raise ParamsError(f"executor.workers is {workers}; it must be at least 1, or null for one per core")
    if name not in EXECUTORS:
        raise ParamsError(f"executor.name `{name}` is unknown; valid: {', '.join(sorted(EXECUTORS))}")
    return EXECUTORS[name](workers, threads)
