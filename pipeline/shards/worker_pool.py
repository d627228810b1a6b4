"""A pool of spawned processes that knows the item of each process, so that the error of a crash names the item.

A pool of `concurrent.futures` stops when a worker dies, and its error does not name the item.
"""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from pipeline.errors import ShardError
from pipeline.shards.numeric_threads import threads_of_children

Item = TypeVar("Item")
Result = TypeVar("Result")

_SPAWN = multiprocessing.get_context("spawn")


class RemoteTraceback(Exception):
    """The traceback of an error in a worker, as its cause."""


def map_in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int, threads: int
) -> Iterator[Result]:
    """Apply a picklable function in `workers` processes, and yield the results as they are done.

    The first error stops all workers and is raised here with a note of its item; Ctrl-C and a caller that stops early
    stop them too.

    Args:
        function: A function of a module.
        items: What it is applied to; picklable.
        workers: How many processes.
        threads: Numeric threads per process.

    Raises:
        ShardError: A worker died; the message names its item.
    """
    waiting = list(reversed(items))
    busy: dict[Connection, tuple[SpawnProcess, Item]] = {}
    with _no_interrupts_inherited(), threads_of_children(threads):
        pool = [_start(function) for _ in range(min(workers, len(items)))]
    try:
        for process, connection in pool:
            _give(waiting.pop(), process, connection, busy)
        while busy:
            for ready in wait(list(busy)):
                assert isinstance(ready, Connection)
                process, item = busy.pop(ready)
                yield _receive(ready, process, item)
                if waiting:
                    _give(waiting.pop(), process, ready, busy)
                else:
                    ready.close()  # which ends the worker
    finally:
        if busy:
            for process, _ in busy.values():
                process.terminate()
        for process, connection in pool:
            connection.close()
            process.join()


def _start(function: Callable[[Item], Result]) -> tuple[SpawnProcess, Connection]:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=_work, args=(function, theirs), daemon=True)
    process.start()
    theirs.close()
    return process, ours


def _give(
    item: Item, process: SpawnProcess, connection: Connection, busy: dict[Connection, tuple[SpawnProcess, Item]]
) -> None:
    busy[connection] = (process, item)
    with suppress(BrokenPipeError):  # it died, which `_receive` reports
        connection.send(item)


def _receive(connection: Connection, process: SpawnProcess, item: object) -> Any:
    try:
        error, text, result = connection.recv()
    except (EOFError, ConnectionResetError):
        process.join()
        raise ShardError(
            f"{item}: the worker process died ({_ending(process.exitcode)}); nothing half-written is left and what "
            "was computed is in the store: run the same command again, with fewer workers if memory was short"
        ) from None
    if error is not None:
        error.add_note(f"in {item}")
        raise error from RemoteTraceback(f"\n{text}")
    return result


def _ending(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        name = signal.Signals(-exitcode).name
        return f"{name}, which the system sends when memory is short" if name == "SIGKILL" else name
    return f"exit code {exitcode}"


def _work(function: Callable[[Item], Result], connection: Connection) -> None:
    """Receive items and send their outcomes until the connection is closed; runs in a worker."""
    threading.Thread(target=die_with_parent, daemon=True).start()
    while True:
        try:
            item = connection.recv()
        except (EOFError, ConnectionResetError):
            return
        outcome: tuple[Exception | None, str, Result | None]
        try:
            outcome = (None, "", function(item))
        except Exception as error:  # handled in the parent
            outcome = (_picklable(error), traceback.format_exc(), None)
        connection.send(outcome)


def _picklable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling an unknown exception may raise anything
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def die_with_parent() -> None:
    """Exit when the parent is gone: a parent that is killed cannot stop its workers."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


@contextmanager
def _no_interrupts_inherited() -> Iterator[None]:
    """Processes started meanwhile ignore Ctrl-C, which the terminal sends to all; the parent stops them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
