"""Runs that are killed, stopped or crash: what they leave and how they go on. Each is a process of its own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import toy_stage
from toy_stage import drop_until_shard_2, make

from pipeline.errors import ShardError
from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files
from pipeline.shards.store import Store


def start(root: Path, then: str) -> subprocess.Popen[str]:
    """The toy stage with 2 workers, of which some wait for a minute in shard 2 and later."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, toy_stage.__file__, str(root), then]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, env=environment, stdout=pipe, stderr=pipe, text=True, start_new_session=True, preexec_fn=hear_ctrl_c
    )


def hear_ctrl_c() -> None:
    """A shell starts its background jobs, such as these tests may be, so that they ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def wait_until_it_waits(process: subprocess.Popen[str], root: Path) -> None:
    """Until both shards before the waiting ones are in the store."""
    store = Store(root / "store")
    for _ in range(600):
        if (root / "flag").exists() and len(list(store.shards())) == 2:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    raise AssertionError("it did not get there")


def processes_of(session: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(folder.name))
    return found


def wait_until_gone(session: int) -> None:
    for _ in range(100):
        if not processes_of(session):
            return
        time.sleep(0.1)
    raise AssertionError(f"still running: {processes_of(session)}")


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_a_stopped_run_leaves_no_half_shard_and_no_process_and_goes_on_where_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sent: signal.Signals, code: int
) -> None:
    process = start(tmp_path, "wait")
    wait_until_it_waits(process, tmp_path)
    if sent == signal.SIGINT:
        os.killpg(process.pid, sent)  # Ctrl-C reaches the workers too
    else:
        process.send_signal(sent)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    assert "Traceback" not in errors
    wait_until_gone(process.pid)
    assert not (tmp_path / "drop").exists()

    (tmp_path / "flag").unlink()
    make(tmp_path, clips=8, compute=drop_until_shard_2, extra={"then": "wait", "flag": f"{tmp_path}/flag"})
    assert "2 shards, 0 computed, 2 from the store" in capsys.readouterr().out
    make(tmp_path, clips=12)  # computes, and so sweeps the store
    assert not list((tmp_path / "store" / "tmp").iterdir())


def test_a_run_after_a_kill_has_the_bytes_of_one_that_was_not_killed(tmp_path: Path) -> None:
    process = start(tmp_path / "killed", "wait")
    wait_until_it_waits(process, tmp_path / "killed")
    process.kill()
    process.communicate()
    make(tmp_path / "killed")
    make(tmp_path / "whole")
    assert hash_files(tmp_path / "killed" / "drop") == hash_files(tmp_path / "whole" / "drop")


def test_the_error_of_a_worker_that_dies_names_its_shard(tmp_path: Path) -> None:
    with pytest.raises(ShardError, match=r"drop train, clips (8 to 11|12 to 15): the worker process died \(SIGKILL"):
        make(tmp_path, workers=2, compute=drop_until_shard_2, extra={"then": "die"})
    assert not (tmp_path / "drop").exists()
    make(tmp_path, clips=8)  # the store is sound
