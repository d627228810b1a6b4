"""Training in several processes of one machine, started as torchrun does: one a GPU, or on processors by gloo.

Each process takes its share of every batch, and the gradients are averaged, so that the steps are those of one process
with the whole batch, up to rounding. They die with the process that started them.
"""

from __future__ import annotations

import os
import signal
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from pipeline.errors import ModelError
from pipeline.shards.numeric_threads import threads_of_children
from pipeline.shards.worker_pool import die_with_parent

if TYPE_CHECKING:
    import torch


def in_processes(function: Callable[..., Any], count: int, *arguments: object) -> Any:
    """The result of a function: of one call in this process, or of the first of `count` processes that all call it.

    Args:
        function: A function of a module; only the first process (`is_first`) writes results.
        count: How many processes.
        arguments: Of the function; picklable.

    Raises:
        ModelError: A process died; what it had reached is in its last checkpoint.
    """
    if count == 1:
        return function(*arguments)
    from torch.distributed.elastic.multiprocessing.api import SignalException
    from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
    from torch.distributed.launcher.api import LaunchConfig, elastic_launch

    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=count,
        run_id=uuid.uuid4().hex,
        rdzv_backend="c10d",
        rdzv_endpoint="127.0.0.1:0",
        max_restarts=0,
        monitor_interval=0.2,
    )
    try:
        with _own_signals(), threads_of_children(max(1, len(os.sched_getaffinity(0)) // count)):
            return elastic_launch(config, _call)(function, arguments)[0]
    except SignalException as error:
        if error.sigval == signal.SIGINT:
            raise KeyboardInterrupt from None
        raise SystemExit(128 + error.sigval) from None
    except ChildFailedError as error:
        rank, failure = error.get_first_failure()
        raise ModelError(
            f"process {rank} of the training died ({failure.message}); run it again, and it goes on from its last "
            "checkpoint"
        ) from error


@contextmanager
def _own_signals() -> Iterator[None]:
    """What this process does on a signal stays as it was, though torch sets its own meanwhile."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _call(function: Callable[..., Any], arguments: tuple[object, ...]) -> Any:
    """Runs in each process."""
    threading.Thread(target=die_with_parent, daemon=True).start()
    return function(*arguments) if is_first() else (function(*arguments), None)[1]


def is_first() -> bool:
    """Whether this process is the one that writes results: the first of several, or the only one."""
    return int(os.environ.get("RANK", "0")) == 0


def process_count() -> int:
    """How many processes train together."""
    import torch.distributed

    return torch.distributed.get_world_size() if torch.distributed.is_initialized() else 1


def wait_for_all() -> None:
    """Wait until all processes are here."""
    import torch.distributed

    if process_count() > 1:
        torch.distributed.barrier()


def share_of_mean(mean: torch.Tensor, count: int) -> torch.Tensor:
    """A mean over `count` things here, scaled so that its mean over all processes is that over all their things."""
    import torch.distributed

    if process_count() == 1:
        return mean
    counts = torch.tensor(float(count), device=mean.device)
    torch.distributed.all_reduce(counts)
    return mean * (count * process_count() / counts)


def mean_of_all(values: dict[str, float]) -> dict[str, float]:
    """The means of numbers over all processes, which have them under the same names."""
    import torch.distributed

    if process_count() == 1 or not values:
        return values
    means = torch.tensor(list(values.values()), dtype=torch.float64)
    torch.distributed.all_reduce(means)
    return dict(zip(values, (means / process_count()).tolist(), strict=True))


def average_gradients(model: torch.nn.Module) -> None:
    """Give the parameters of each process the mean gradient of all."""
    import torch.distributed

    if process_count() == 1:
        return
    gradients = [p.grad for p in model.parameters() if p.grad is not None]
    sent = [torch.distributed.all_reduce(gradient, async_op=True) for gradient in gradients]
    for gradient, work in zip(gradients, sent, strict=True):
        work.wait()
        gradient /= process_count()
