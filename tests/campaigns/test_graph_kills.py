"""`dvc repro` killed at random moments, with all its processes, and run again; the store in a folder or on a server."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from campaign import FULL, rounds
from ruamel.yaml import YAML
from s3_server import S3Server

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

pytestmark = pytest.mark.campaign

MANY = bool(os.environ.get(FULL))
#: With all that it needs: 26 stages, or 2. A shorter campaign: DYNAMICS_CAMPAIGN_TARGET=flow@id, 5 stages.
TARGET = os.environ.get("DYNAMICS_CAMPAIGN_TARGET", "fit@id") if MANY else "compile@id"
LEFT_OUT = shutil.ignore_patterns("__pycache__")
SMALL = {
    "sample": {"shard_size": 1},
    "render": {"width": 120, "height": 80, "backend": "raycast"},
    "flow": {"width": 120, "height": 80, "iterations": 1},
    "finetune": {"steps": 4, "batch_size": 2, "checkpoint_steps": 1},
    "infer": {"samples": 2},
    "search": {"width": 48, "height": 32, "starts": 1},
    "fit": {"simulations": 200},
    "executor": {"workers": 1},
}


def clone(folder: Path) -> Path:
    """The code and the graph, with parameters for a few small clips and no data."""
    folder.mkdir()
    for name in ("pipeline", "stages"):
        shutil.copytree(ROOT / name, folder / name, ignore=LEFT_OUT)
    shutil.copy(ROOT / "dvc.yaml", folder)
    (folder / "models").symlink_to(ROOT / "models")
    shutil.copytree(ROOT / "data/samples/cross_engine_01", folder / "videos/cross_engine_01")
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    for suite, clips in (("train", 4), ("val", 2), ("id", 2)):
        params["suites"][suite]["clips"] = clips
    params["suites"]["real"]["path"] = "videos"
    for section, values in SMALL.items():
        params[section] |= values
    yaml.dump(params, folder / "params.yaml")
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "-q"], cwd=folder, check=True)
    subprocess.run([sys.executable, "-m", "dvc", "config", "core.analytics", "false"], cwd=folder, check=True)
    return folder


def empty(folder: Path) -> Path:
    """The same, as a fresh clone on a machine with an empty disk is. Compiled kernels are found by their folder."""
    for name in ("data", ".shards", ".dvc/cache", ".dvc/tmp"):
        shutil.rmtree(folder / name, ignore_errors=True)
    (folder / "dvc.lock").unlink(missing_ok=True)
    return folder


def start(folder: Path, environment: Mapping[str, str]) -> subprocess.Popen[str]:
    """As `make repro`: dvc.lock is put back where a kill cut it, then `dvc repro`."""
    command = f"{sys.executable} -m stages.graph.lock_copy && exec {sys.executable} -m dvc repro {TARGET}"
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.Popen(
        ["bash", "-c", command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "PATH": path, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=3600)
    assert process.returncode == 0, said
    return said


def killed(process: subprocess.Popen[str], after_s: float) -> bool:
    """Kill the process with all that it started, unless it ends before."""
    try:
        said, _ = process.communicate(timeout=after_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return True
    assert process.returncode == 0, said
    return False


def test_a_graph_that_is_killed_again_and_again_ends_with_the_undisturbed_bytes(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    folder = clone(tmp_path / "clone")
    if MANY:  # the kernels are compiled before the time is taken
        finish(start(folder, {"DYNAMICS_STORE": str(tmp_path / "warm")}))
    began = time.monotonic()
    finish(start(empty(folder), {"DYNAMICS_STORE": str(tmp_path / "sound")}))
    duration = time.monotonic() - began
    expected = hash_files(folder / "data")
    server, place, environment = S3Server(), str(tmp_path / "other"), {}
    if MANY:
        pytest.importorskip("s3fs", reason='S3 is not installed: pip install -e ".[s3]"')
        pytest.importorskip("moto", reason="no S3 server is installed: pip install moto[server]")
        server.start()
        place, environment = "s3://bucket/run", server.environment
    try:
        kills = ended = 0
        store = {**environment, "DYNAMICS_STORE": f"{place}0"}
        empty(folder)
        while kills < len(rounds(1, 10)):
            if killed(start(folder, store), rng.uniform(0.05, 0.5) * duration):
                kills += 1
                continue
            assert hash_files(folder / "data") == expected
            ended += 1
            empty(folder)  # with an empty store: all is computed again
            store["DYNAMICS_STORE"] = f"{place}{ended}"
        finish(start(folder, store))
        assert hash_files(folder / "data") == expected
        assert list(folder.rglob(".*.partial*")) == []
        said = finish(start(empty(folder), store))
        print(f"{TARGET}: {duration:.0f} s undisturbed, {kills} kills, {ended} runs that ended before a kill")
        assert " computed" in said
        assert [line for line in said.splitlines() if "shard" in line and " 0 computed" not in line] == []
        assert hash_files(folder / "data") == expected
    finally:
        server.stop()
