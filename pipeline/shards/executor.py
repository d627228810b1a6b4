"""Where the shards are computed: on this machine, or as one share of a batch job."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pipeline.errors import ParamsError
from pipeline.shards.numeric_threads import threads_here
from pipeline.shards.worker_pool import map_in_processes

Item = TypeVar("Item")
Result = TypeVar("Result")

RANK, WORLD_SIZE = "DYNAMICS_RANK", "DYNAMICS_WORLD_SIZE"


class SliceFinished(Exception):
    """One share of the shards is computed. A last call without rank and world size makes the output folder."""


class Executor(Protocol):
    """What `map_shards` needs of an executor; `EXECUTORS` lists them."""

    def share(self, items: Sequence[Item]) -> Sequence[Item]:
        """The items that this process computes: all, except in a batch job."""

    @property
    def collects(self) -> bool:
        """Whether the output folder is made at the end. If not, the shards stay in the store."""

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Apply a picklable function to picklable items; results in the order of completion."""


@dataclass(frozen=True)
class LocalExecutor:
    """Spawned processes on this machine; this process itself where there is one worker or one item."""

    workers: int
    threads: int
    collects = True

    def share(self, items: Sequence[Item]) -> Sequence[Item]:
        return items

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


@dataclass(frozen=True)
class SliceExecutor:
    """Every `world_size`-th item from `rank` on, for the array jobs of a batch scheduler."""

    local: LocalExecutor
    rank: int
    world_size: int
    collects = False

    def share(self, items: Sequence[Item]) -> Sequence[Item]:
        return items[self.rank :: self.world_size]

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        return self.local.map(function, items)


def _local(workers: int, threads: int) -> Executor:
    return LocalExecutor(workers, threads)


def _slice(workers: int, threads: int) -> Executor:
    try:
        rank, world_size = int(os.environ[RANK]), int(os.environ[WORLD_SIZE])
    except KeyError as error:
        raise ParamsError(f"{RANK} and {WORLD_SIZE} go together; {error.args[0]} is not set") from None
    except ValueError as error:
        raise ParamsError(f"{RANK} and {WORLD_SIZE} must be whole numbers ({error})") from None
    if not 0 <= rank < world_size:
        raise ParamsError(f"{RANK} is {rank}; with {WORLD_SIZE}={world_size} it must be 0 to {world_size - 1}")
    return SliceExecutor(LocalExecutor(workers, threads), rank, world_size)


def _ray(workers: int, threads: int) -> Executor:
    raise ParamsError("executor.name `ray` comes with a later release; `local` uses this machine, `slice` a batch job")


EXECUTORS: dict[str, Callable[[int, int], Executor]] = {"local": _local, "slice": _slice, "ray": _ray}


def make_executor(name: str, workers: int | None, threads: int = 1) -> Executor:
    """The executor of that name, or `slice` where the environment has a rank. `workers` None: one per core.

    Raises ParamsError for an unknown name and for a rank that is not in the world.
    """
    if workers is None:
        workers = max(1, len(os.sched_getaffinity(0)) // threads)
    if workers < 1:
        raise ParamsError(f"executor.workers is {workers}; it must be at least 1, or null for one per core")
    if RANK in os.environ or WORLD_SIZE in os.environ:
        name = "slice"
    if name not in EXECUTORS:
        raise ParamsError(f"executor.name `{name}` is unknown; valid: {', '.join(sorted(EXECUTORS))}")
    return EXECUTORS[name](workers, threads)
