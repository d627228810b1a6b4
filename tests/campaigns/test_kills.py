"""Runs that are killed at random moments and run again: their results are those of a run that nobody disturbed."""

import os
import shutil
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from campaign import rounds
from toy_stage import make, make_weights
from tqdm import tqdm

from pipeline.shards.content_hash import hash_files
from pipeline.shards.keep_folder import keep_folder
from pipeline.shards.prune import prune, usage
from pipeline.shards.store import Store

pytestmark = pytest.mark.campaign


def write_model(folder: Path, scratch: Path, inputs: object, parameters: None) -> dict[str, int]:
    """A model in ten steps, of which a killed run keeps those that it has done."""
    done = scratch / "steps"
    for step in range(int(done.read_text()) if done.exists() else 0, 10):
        part = scratch / "part"
        part.write_text(str(step + 1))
        part.replace(done)
    (folder / "model").write_text(done.read_text() * 10_000)
    return {}


def run(root: Path) -> None:
    """Two stages with shards, one without."""
    make(root, clips=12)
    make_weights(root)
    keep_folder(
        "train",
        root / "model",
        write_model,
        parameters=None,
        inputs=[root / "weigh" / "train"],
        store=Store(root / "store"),
    )


def in_a_child(root: Path, killed_after_s: float | None) -> int:
    """Run in a forked process, which has everything imported; its exit code, -9 where it was killed."""
    child = os.fork()
    if child == 0:
        tqdm.set_lock(threading.RLock())  # the usual one is shared: a killed process would leave it locked for all
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            run(root)
        except BaseException:
            os._exit(1)
        os._exit(0)
    if killed_after_s is not None:
        time.sleep(killed_after_s)
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def results(root: Path) -> dict[str, str]:
    return {name: digest for name, digest in hash_files(root).items() if not name.startswith("store/")}


def test_a_run_that_is_killed_again_and_again_ends_as_one_that_was_not(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    run(tmp_path / "sound")
    expected = results(tmp_path / "sound")
    began = time.monotonic()
    assert in_a_child(tmp_path / "timed", None) == 0
    duration = time.monotonic() - began
    kills = 0
    for _ in rounds(3, 60):
        root = tmp_path / "killed"
        for _ in range(20):
            code = in_a_child(root, rng.uniform(0, 0.4 * duration))
            assert code in (-9, 0)
            kills += code == -9
            if code == 0:
                break
        assert in_a_child(root, None) == 0
        assert results(root) == expected
        assert [path.name for path in root.rglob(".*")] == []
        store = Store(root / "store")
        store.check_writable()  # which removes what killed runs left
        assert usage(store).temporary_bytes == usage(store).scratch_bytes == 0
        shutil.rmtree(root)
    print(f"{kills} kills")
    assert kills


def test_pruning_beside_a_run_changes_nothing_but_its_time(tmp_path: Path) -> None:
    run(tmp_path / "sound")
    for _ in rounds(2, 40):
        root = tmp_path / "pruned"
        child = os.fork()
        if child == 0:
            tqdm.set_lock(threading.RLock())
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            try:
                for _ in range(3):
                    run(root)
            except BaseException:
                os._exit(1)
            os._exit(0)
        store, status = Store(root / "store"), 0
        while os.waitpid(child, os.WNOHANG)[0] == 0:
            prune(store, keep_bytes=0)
            time.sleep(0.005)
        assert status == 0
        run(root)
        assert results(root) == results(tmp_path / "sound")
        shutil.rmtree(root)
