"""All visitors of the page, and how long their files are kept."""

from __future__ import annotations

import threading
import time
import uuid
from pathlib import Path

from pipeline.app.job import JobQueue
from pipeline.app.uploads import UploadError
from pipeline.app.visitor import Visitor


class Visitors:
    """Visitors by the token in their cookie.

    Args:
        root: A folder of ours.
        most: How many there may be. Those who have done nothing make room, and others after IDLE_SECONDS.
    """

    IDLE_SECONDS = 3600.0

    def __init__(self, root: Path, most: int = 16) -> None:
        self.root, self.most, self.queue = root, most, JobQueue()
        self._all: dict[str, Visitor] = {}
        self._lock = threading.Lock()

    def get(self, token: str | None) -> Visitor | None:
        """The visitor of a token."""
        with self._lock:
            visitor = self._all.get(token or "")
        if visitor is not None:
            visitor.seen = time.monotonic()
        return visitor

    def add(self) -> tuple[str, Visitor]:
        """A new visitor and their token. Raises UploadError where there are too many."""
        with self._lock:
            now = time.monotonic()
            for token in [t for t, v in self._all.items() if now - v.seen > self.IDLE_SECONDS and not v.busy]:
                self._all.pop(token).close()
            empty = [t for t, v in self._all.items() if v.is_empty]
            if len(self._all) >= self.most and empty:
                self._all.pop(min(empty, key=lambda t: self._all[t].seen)).close()
            if len(self._all) >= self.most:
                raise UploadError(f"{self.most} visitors are here already; try again later")
            token = uuid.uuid4().hex
            folder = self.root / uuid.uuid4().hex[:12]
            folder.mkdir()
            visitor = self._all[token] = Visitor(folder, self.queue)
            return token, visitor

    def close(self) -> None:
        """End all jobs and remove all files."""
        self.queue.close()
        with self._lock:
            for visitor in self._all.values():
                visitor.close()
            self._all.clear()
