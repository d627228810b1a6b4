"""Answers of a long benchmark, kept as they come: a JSON object a line, so that a run that was stopped goes on."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

Answer = dict[str, Any]
Job = TypeVar("Job")


def kept_answers(path: Path) -> list[Answer]:
    """What was answered so far; none where there is no such file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def answers_of(
    answer: Callable[[Job], Answer], jobs: Sequence[Job], path: Path, workers: int, minutes: float | None
) -> Iterator[Answer]:
    """The answers to `jobs` as they come, each appended to the file `path` first; no more after so many minutes."""
    until = time.monotonic() + 60 * minutes if minutes else float("inf")
    with multiprocessing.get_context("spawn").Pool(workers) as pool, path.open("a") as file:
        for result in pool.imap_unordered(answer, jobs):
            file.write(json.dumps(result) + "\n")
            file.flush()
            yield result
            if time.monotonic() > until:
                return
