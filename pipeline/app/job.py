"""A long computation in a process of its own, which tells how far it is and can be ended at any time."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.errors import DynamicsError, ParamsError

MOST_SECONDS = 1800
KINDS = {
    "bodies": "finding the bodies",
    "infer": "finding the scene",
    "edit": "editing the clip",
    "discover": "comparing",
}
WAITING, RUNNING, DONE, FAILED, CANCELLED = "waiting", "running", "done", "failed", "cancelled"
ENDED = (DONE, FAILED, CANCELLED)
INTERNAL = "something went wrong inside; the window in which `dynamics app` runs has the details"


@dataclass
class Job:
    """One computation.

    Attributes:
        kind: Of KINDS.
        request: What the worker is told (worker.py), JSON.
        folder: Its own, which it may fill; removed unless the job is done.
        when_done: Called with the worker's result, once, before the state becomes DONE.
        state: WAITING, RUNNING, DONE, FAILED or CANCELLED.
        step: What it is at.
        share: How far it is, 0 to 1.
        lines: What it said.
        error: Why it failed.
    """

    kind: str
    request: dict[str, Any]
    folder: Path
    when_done: Callable[[dict[str, Any]], None]
    state: str = WAITING
    step: str = ""
    share: float = 0.0
    lines: list[str] = field(default_factory=list)
    error: str = ""
    _process: subprocess.Popen[bytes] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def run(self) -> None:
        """Run it to its end, in the thread of the caller."""
        with self._lock:
            if self.state != WAITING:
                return
            self.state = RUNNING
            scratch = self.folder / "scratch"
            scratch.mkdir(parents=True)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pipeline.app.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env=os.environ | {"TMPDIR": str(scratch)},
            )
        process = self._process
        watch = threading.Timer(MOST_SECONDS, self._too_long)
        watch.daemon = True
        watch.start()
        result: dict[str, Any] | None = None
        try:
            assert process.stdin is not None and process.stdout is not None
            with suppress(BrokenPipeError):
                process.stdin.write(json.dumps(self.request).encode() + b"\n")
                process.stdin.flush()  # it stays open: the worker ends where this process does
            for line in process.stdout:
                told = json.loads(line)
                if "result" in told:
                    result = told["result"]
                self._note(told)
            process.wait()
            with self._lock:
                if result is not None and self.state == RUNNING:
                    shutil.rmtree(scratch, ignore_errors=True)
                    try:
                        self.when_done(result)
                        self.state = DONE
                    except DynamicsError as error:
                        self.error = str(error)
        finally:
            watch.cancel()
            self._kill()
            with suppress(OSError):
                process.stdin.close()  # type: ignore[union-attr]
            if self.state == RUNNING:
                self.state, self.error = FAILED, self.error or INTERNAL
            if self.state != DONE:
                shutil.rmtree(self.folder, ignore_errors=True)

    def cancel(self) -> None:
        """End it; nothing that it wrote is left."""
        with self._lock:
            if self.state in ENDED:
                return
            waiting, self.state = self.state == WAITING, CANCELLED
        self._kill()
        if waiting:
            shutil.rmtree(self.folder, ignore_errors=True)

    def status(self) -> dict[str, Any]:
        """For the page."""
        return {
            "kind": self.kind,
            "title": KINDS[self.kind],
            "state": self.state,
            "step": self.step,
            "share": round(self.share, 3),
            "lines": self.lines[-40:],
            "error": self.error,
        }

    def _note(self, told: dict[str, Any]) -> None:
        self.step = str(told.get("step", self.step))
        self.share = float(told.get("share", self.share))
        self.error = str(told.get("error", self.error))
        if "line" in told:
            self.lines.append(str(told["line"]))

    def _too_long(self) -> None:
        self.error = f"it took more than {MOST_SECONDS // 60} minutes and was ended; try a shorter clip"
        self._kill()

    def _kill(self) -> None:
        process = self._process
        if process is not None and process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


class JobQueue:
    """Runs one job after another, first come first served."""

    def __init__(self) -> None:
        self._jobs: list[Job] = []
        self._changed = threading.Condition()
        self._closed = False
        threading.Thread(target=self._work, name="jobs", daemon=True).start()

    def add(self, job: Job) -> None:
        """Put a job at the end. Raises ParamsError where the queue is closed."""
        with self._changed:
            if self._closed:
                raise ParamsError("the server is ending")
            self._jobs.append(job)
            self._changed.notify()

    def before(self, job: Job) -> int:
        """How many jobs are run before this one."""
        with self._changed:
            waiting = [j for j in self._jobs if j.state not in ENDED]
            return waiting.index(job) if job in waiting else 0

    def close(self) -> None:
        """End all jobs."""
        with self._changed:
            self._closed = True
            jobs, self._jobs = self._jobs, []
            self._changed.notify()
        for job in jobs:
            job.cancel()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._jobs = [j for j in self._jobs if j.state not in ENDED]
                while not self._jobs and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                job = self._jobs[0]
            try:
                job.run()
            except Exception:  # the queue goes on; what happened is shown where the server runs
                traceback.print_exc()
