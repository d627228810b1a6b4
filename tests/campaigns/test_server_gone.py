"""The S3 server does not answer for a minute while a run computes."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import toy_stage
from campaign import FULL
from s3_server import S3Server

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

pytestmark = pytest.mark.campaign

AWAY_S = 60.0 if os.environ.get(FULL) else 3.0
PROGRAM = """
import sys
from toy_stage import Drop, drop
from pipeline.shards.map_shards import map_shards
map_shards("drop", "train", sys.argv[1], drop, parameters=Drop(1), clips=80, shard_size=2, workers=1)
"""


def run(out: Path, cache: Path, server: S3Server) -> str:
    environment = {
        **os.environ,
        **server.environment,
        "DYNAMICS_STORE": "s3://bucket/run",
        "DYNAMICS_CACHE": str(cache),
        "PYTHONPATH": f"{ROOT}:{Path(toy_stage.__file__).parent}",
    }
    command = [sys.executable, "-c", PROGRAM, str(out)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def silent(server: S3Server) -> None:
    """It takes connections and says nothing."""
    assert server.process is not None
    server.process.send_signal(signal.SIGSTOP)
    time.sleep(AWAY_S)
    server.process.send_signal(signal.SIGCONT)


def test_a_run_waits_for_the_server_and_ends_with_the_undisturbed_bytes(tmp_path: Path, server: S3Server) -> None:
    run(tmp_path / "sound", tmp_path / "warm", server)
    server.stop()
    server.start()
    cache = tmp_path / "cache"

    def disturb() -> None:
        while not list(cache.glob("published/*/*")):
            time.sleep(0.02)
        silent(server)

    other = threading.Thread(target=disturb)
    other.start()
    began = time.monotonic()
    run(tmp_path / "disturbed", cache, server)
    other.join()
    assert hash_files(tmp_path / "disturbed") == hash_files(tmp_path / "sound")
    print(f"the server was silent for {AWAY_S:.0f} s, the run took {time.monotonic() - began:.0f} s")
    assert "40 shards, 0 computed" in run(tmp_path / "second", tmp_path / "fresh", server)
    assert hash_files(tmp_path / "second") == hash_files(tmp_path / "sound")
