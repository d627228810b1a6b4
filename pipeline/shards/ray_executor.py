"""Shards as tasks of a Ray cluster, or of one that is started on this machine.

Where `RAY_ADDRESS` names a cluster, its machines get the code (this folder without what git ignores), and need a store
that they share; without it, a cluster is started here and ends with the stage.
"""

import atexit
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import ParamsError, ShardError
from pipeline.shards.numeric_threads import thread_variables
from pipeline.shards.worker_pool import RemoteTraceback

Item = TypeVar("Item")
Result = TypeVar("Result")

ADDRESS = "RAY_ADDRESS"
CLIENT = "ray://"  # begins an address by which another machine reaches a cluster through one port
RETRIES = 5  # of a task whose worker or machine died; a task that raised is never tried again
#: Nothing is reported to Ray's makers; workers have the priority of this process, not the lowest.
_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
#: What the machines do not get. The code has the same hash for all stages of a run, so that it travels once.
_LEFT_HERE = ["/[!.]*", "/.?*", "!/pipeline", "!/pipeline/**", "!/stages", "!/stages/**", "__pycache__"]
CHECK_S = 5.0  # between two looks at whether the head answers
GONE_S = 20.0  # without an answer of the head; Ray itself ends this process after 60


@dataclass(frozen=True)
class RayExecutor:
    """Tasks of a Ray cluster.

    Attributes:
        workers: How many tasks are in flight at most; None: as many as the cluster has room for.
        threads: Numeric threads of a task, which takes as many cores.
    """

    workers: int | None
    threads: int

    @property
    def distant(self) -> bool:
        """Whether the workers may be on other machines."""
        return os.environ.get(ADDRESS, "local") not in ("", "local")

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Apply a function to items; results in the order of completion.

        Raises ShardError where an item's workers died again and again, and what the function raised.
        """
        if not items:
            return
        with self._cluster() as ray:
            resources = ray.cluster_resources()
            task = ray.remote(_call).options(
                num_cpus=self.threads,
                max_retries=RETRIES,
                retry_exceptions=False,
            )
            room = max(1, int(resources.get("CPU", 1) // self.threads))
            in_flight = self.workers or 2 * room  # twice, so that no core waits for this process
            waiting, busy = list(reversed(items)), dict[Any, Item]()
            head = _Head.of(ray)
            try:
                while waiting or busy:
                    while waiting and len(busy) < in_flight:
                        item = waiting.pop()
                        busy[task.remote(function, item, None if self.distant else str(Path.cwd()))] = item
                    done, _ = ray.wait(list(busy), num_returns=1, timeout=CHECK_S)
                    head.check()
                    for reference in done:
                        yield _result(ray, reference, busy.pop(reference))
            finally:
                if not head.gone:
                    for reference in busy:
                        ray.cancel(reference, force=True)

    @contextmanager
    def _cluster(self) -> Iterator[Any]:
        for name, value in _SETTINGS.items():
            os.environ.setdefault(name, value)
        try:
            import ray
        except ImportError:
            raise ParamsError(
                'executor.name `ray` needs Ray: pip install -e ".[ray]"; valid without it: local'
            ) from None
        if ray.is_initialized():
            yield ray
            return
        environment: dict[str, Any] = {"env_vars": thread_variables(self.threads)}
        settings: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
        if self.distant:
            environment |= {"working_dir": str(Path.cwd()), "excludes": _LEFT_HERE}
            environment["env_vars"] |= {
                k: os.environ[k]
                for k in ("AWS_ENDPOINT_URL", "AWS_DEFAULT_REGION", "DYNAMICS_STORE")
                if k in os.environ
            }
            settings["address"] = address = os.environ[ADDRESS]
            _check_address(address)
        else:
            environment["env_vars"]["PYTHONPATH"] = os.pathsep.join(filter(None, [str(Path.cwd()), *sys.path]))
            cores = self.workers * self.threads if self.workers else None
            settings |= {"address": "local", "num_cpus": cores, "include_dashboard": False}
        try:
            ray.init(runtime_env=environment, **settings)
        except (ConnectionError, OSError, RuntimeError, ValueError) as error:
            raise _unreachable(error) from None
        try:
            yield ray
        except HeadGoneError:
            atexit.unregister(ray.shutdown)  # it would wait for the head
            atexit.register(_exit_at_once)
            raise
        except BaseException:
            ray.shutdown()
            raise
        ray.shutdown()


class HeadGoneError(ShardError):
    """The head of the cluster does not answer any more."""


class _Head:
    """The process that holds a cluster together. Without it Ray waits, and then ends this process without an error."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._asked = time.monotonic()
        self._silent_since: float | None = None
        self.gone = False

    @staticmethod
    def of(ray: Any) -> "_Head":
        configured = os.environ.get(ADDRESS, "")
        through_client = configured.startswith(CLIENT)  # then only that port may be reachable
        return _Head(configured.removeprefix(CLIENT) if through_client else ray.get_runtime_context().gcs_address)

    def check(self) -> None:
        """Ask every CHECK_S. Raises HeadGoneError where there was no answer for GONE_S."""
        now = time.monotonic()
        if now - self._asked < CHECK_S:
            return
        self._asked = now
        try:
            _knock(self._address)
            self._silent_since = None
        except OSError as error:
            self._silent_since = now if self._silent_since is None else self._silent_since
            if now - self._silent_since >= GONE_S:
                self.gone = True
                raise HeadGoneError(
                    f"the head of the Ray cluster ({self._address}) has not answered for {GONE_S:g} s ({error}); what "
                    "was computed is in the store: start the cluster and run it again"
                ) from None


def _exit_at_once() -> None:
    """End this process without Python's clean-up, in which Ray's threads crash where the head is gone."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(2)


def _check_address(address: str) -> None:
    """Raise ParamsError at once where no cluster is there; Ray itself tries for minutes."""
    if address == "auto":  # Ray finds the cluster of this machine
        return
    try:
        _knock(address.removeprefix(CLIENT))
    except (OSError, ValueError) as error:
        raise _unreachable(error) from None


def _unreachable(error: Exception) -> ParamsError:
    return ParamsError(f"no Ray cluster can be reached ({ADDRESS}={os.environ.get(ADDRESS)}): {error}")


def _knock(address: str) -> None:
    """Raise OSError where nothing takes connections at host:port."""
    host, _, port = address.rpartition(":")
    socket.create_connection((host.strip("[]"), int(port)), timeout=CHECK_S).close()


def _call(function: Callable[[Item], Result], item: Item, folder: str | None) -> Result:
    """Runs in a worker, on this machine in the folder of the process that asks."""
    if folder is not None:
        os.chdir(folder)
    return function(item)


def _result(ray: Any, reference: Any, item: object) -> Any:
    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        cause = error.cause if isinstance(error.cause, Exception) else RuntimeError(str(error))
        cause.add_note(f"in {item}")
        raise cause from RemoteTraceback(f"\n{error}")
    except ray.exceptions.RayError as error:
        raise ShardError(
            f"{item}: its workers died {RETRIES + 1} times ({str(error).splitlines()[0]}); nothing half-written is "
            "left, and what was computed is in the store: run it again, with fewer workers if memory was short"
        ) from None
