"""Answers of a long benchmark as JSON lines, appended one by one, so that a stopped run can be continued."""

from __future__ import annotations

import json
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

Answer = dict[str, Any]
Job = TypeVar("Job")


@contextmanager
def kept_folder(named: Path | None) -> Iterator[Path]:
    """A folder for what a benchmark keeps: the one that was named, made where it is missing, else a temporary one."""
    with tempfile.TemporaryDirectory() as passing:
        folder = (named or Path(passing)).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


def kept_answers(path: Path) -> list[Answer]:
    """The answers so far; none where the file is missing."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def answers_of(
    answer: Callable[[Job], Answer], jobs: Sequence[Job], path: Path, workers: int, minutes: float | None
) -> Iterator[Answer]:
    """Answer jobs in worker processes, and yield each answer after it was appended to a file.

    Args:
        answer: Runs in the workers.
        jobs: In the order in which they start.
        path: JSON lines.
        workers: Number of processes.
        minutes: Stop after so long; None: answer all.
    """
    until = time.monotonic() + 60 * minutes if minutes else float("inf")
    with multiprocessing.get_context("spawn").Pool(workers) as pool, path.open("a") as file:
        for result in pool.imap_unordered(answer, jobs):
            file.write(json.dumps(result) + "\n")
            file.flush()
            yield result
            if time.monotonic() > until:
                return
