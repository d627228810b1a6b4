"""A server of `dynamics app` in a thread of the tests, and a visitor who speaks HTTP without a browser."""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.app.server import AppServer


@contextmanager
def serving() -> Iterator[AppServer]:
    """A server at a free port of this machine; ended, with its jobs and files, at the end."""
    with AppServer("127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


class Guest:
    """A visitor."""

    def __init__(self, server: AppServer) -> None:
        self.port = int(server.server_address[1])
        status, headers, _ = self.send("GET", "/", cookie=None)
        assert status == 200
        self.cookie = headers["Set-Cookie"].split(";")[0]

    def send(
        self, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None, **other: Any
    ) -> tuple[int, Any, bytes]:
        """Status, headers and body of the answer."""
        cookie = other.get("cookie", getattr(self, "cookie", None))
        given = ({"Cookie": cookie} if cookie else {}) | (headers or {})
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        connection.request(method, path, body, given)
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer.status, answer.headers, data

    def get(self, path: str) -> Any:
        return json.loads(self.send("GET", path)[2])

    def post(self, path: str, body: Any = None) -> Any:
        """The answer's JSON; `error` where it was refused."""
        return json.loads(self.send("POST", path, json.dumps(body or {}).encode(), {"X-Dynamics": "1"})[2])

    def upload(self, kind: str, name: str, data: bytes) -> Any:
        path = f"/api/upload?kind={kind}&name={name}"
        return json.loads(self.send("POST", path, data, {"X-Dynamics": "1"})[2])

    def wait(self, *states: str, seconds: float = 300) -> dict[str, Any]:
        """The job's status as soon as it has one of these states."""
        end = time.monotonic() + seconds
        while True:
            status = self.get("/api/job")
            if status["state"] in states:
                return status
            assert time.monotonic() < end, status
            time.sleep(0.05)


def files(folder: Path) -> list[str]:
    """All files below a folder."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
