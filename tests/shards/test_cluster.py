"""A cluster of three nodes, each with a cache of its own and no data/, and a store on an S3 server."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML
from s3_server import S3Server

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

STAGES = ("sample", "compile", "simulate")
CLIPS = 3


@pytest.fixture
def server() -> Iterator[S3Server]:
    pytest.importorskip("s3fs", reason='S3 is not installed: pip install -e ".[s3]"')
    pytest.importorskip("moto", reason="no S3 server is installed: pip install moto[server]")
    started = S3Server()
    started.start()
    yield started
    started.stop()


@pytest.fixture
def nodes(server: S3Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, list[Any]]]:
    """The cluster and its two nodes beside the head, which computes nothing."""
    pytest.importorskip("ray", reason='Ray is not installed: pip install -e ".[ray]"')
    from ray.cluster_utils import Cluster

    for name, value in {**server.environment, "RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}.items():
        monkeypatch.setenv(name, value)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    yield (
        cluster,
        [cluster.add_node(num_cpus=1, env_vars={"DYNAMICS_CACHE": str(tmp_path / f"node{k}")}) for k in range(2)],
    )
    cluster.shutdown()


def repository(folder: Path, **executor: object) -> Path:
    """The code, with parameters for a few small clips."""
    folder.mkdir()
    for name in ("pipeline", "stages"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["suites"]["id"]["clips"] = CLIPS
    params["sample"]["shard_size"] = 1
    params["render"] |= {"width": 120, "height": 80, "backend": "raycast"}
    params["executor"] |= executor
    yaml.dump(params, folder / "params.yaml")
    return folder


def start(folder: Path, stage: str, **environment: str) -> subprocess.Popen[str]:
    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "DYNAMICS_STORE")}
    return subprocess.Popen(
        [sys.executable, "-m", f"stages.{stage}", "id"],
        cwd=folder,
        env={**own, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=900)
    assert process.returncode == 0, said
    return said


@pytest.mark.slow
def test_three_nodes_of_which_one_is_killed_give_the_bytes_of_one_machine(
    nodes: tuple[Any, list[Any]], tmp_path: Path
) -> None:
    cluster, (first, _) = nodes
    local = repository(tmp_path / "local", workers=1)
    for stage in STAGES:
        finish(start(local, stage, DYNAMICS_STORE=str(tmp_path / "store")))

    shared = repository(tmp_path / "shared", name="ray")
    environment = {
        "DYNAMICS_STORE": "s3://bucket/run",
        "DYNAMICS_CACHE": str(tmp_path / "driver"),
        "RAY_ADDRESS": cluster.address,
    }
    finish(start(repository(tmp_path / "first", workers=1), STAGES[0], **{**environment, "RAY_ADDRESS": ""}))
    shutil.copytree(tmp_path / "first" / "data", shared / "data")  # the rasteriser need not be compiled on every node
    for stage in STAGES[1:]:
        process = start(shared, stage, **environment)
        if stage == "simulate":
            while not list((tmp_path / "node0").glob("??/*/contacts.parquet")) and process.poll() is None:
                time.sleep(0.1)
            cluster.remove_node(first, allow_graceful=False)
        finish(process)
    assert hash_files(shared / "data") == hash_files(local / "data")

    again = repository(tmp_path / "again", workers=1)  # another machine with an empty disk
    for stage in STAGES:
        fresh = {"DYNAMICS_STORE": "s3://bucket/run", "DYNAMICS_CACHE": str(tmp_path / "fresh")}
        assert f"{CLIPS} shards, 0 computed, {CLIPS} from the store" in finish(start(again, stage, **fresh))
    assert hash_files(again / "data") == hash_files(local / "data")
