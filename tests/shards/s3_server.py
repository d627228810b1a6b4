"""A real S3 server in a process of its own: moto's."""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import suppress

import pytest


class S3Server:
    """Keeps everything in its memory. `start` again after `stop` gives an empty server at the same address."""

    def __init__(self) -> None:
        with socket.socket() as chosen:
            chosen.bind(("127.0.0.1", 0))
            self.port = chosen.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def environment(self) -> dict[str, str]:
        return {
            "AWS_ENDPOINT_URL": self.url,
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }

    def start(self) -> None:
        command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(self.port)]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ)
        for _ in range(600):
            with suppress(OSError), urllib.request.urlopen(f"{self.url}/moto-api/"):
                break
            time.sleep(0.1)
        request = urllib.request.Request(f"{self.url}/bucket", method="PUT")
        with suppress(OSError):
            urllib.request.urlopen(request)

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None


@pytest.fixture(scope="module")
def server() -> Iterator[S3Server]:
    """A server for the tests of a module; it has the empty bucket `bucket`. tests/conftest.py makes it known."""
    pytest.importorskip("s3fs", reason='S3 is not installed: pip install -e ".[s3]"')
    pytest.importorskip("moto", reason="no S3 server is installed: pip install moto[server]")
    started = S3Server()
    started.start()
    yield started
    started.stop()
