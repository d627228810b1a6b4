"""A cluster of three nodes, each with a cache of its own and no data/, and a store on an S3 server."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from ray_cluster import RayCluster, ray_cluster
from ruamel.yaml import YAML
from s3_server import S3Server

from pipeline.shards.code_hash import ROOT
from pipeline.shards.content_hash import hash_files

pytestmark = pytest.mark.slow

STAGES = ("sample", "compile", "simulate")
CLIPS = 3
#: Three tasks, of which one ends at once and two wait.
WAITS = """
import time
from pipeline.shards.ray_executor import RayExecutor
from stages.graph.run import run
def main():
    for _ in RayExecutor(None, 1).map(time.sleep, [0.0, 300.0, 300.0]):
        print("connected", flush=True)
run(main, [])
"""


@pytest.fixture
def cluster(server: S3Server, tmp_path: Path) -> Iterator[RayCluster]:
    with ray_cluster(tmp_path, server.environment) as started:
        yield started


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one machine computes."""
    root = tmp_path_factory.mktemp("local")
    folder = repository(root / "clone", workers=1)
    for stage in STAGES:
        finish(start(folder, stage, DYNAMICS_STORE=str(root / "store")))
    return folder


def repository(folder: Path, clips: int = CLIPS, **executor: object) -> Path:
    """The code, with parameters for a few small clips."""
    folder.mkdir()
    for name in ("pipeline", "stages"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["suites"]["id"]["clips"] = clips
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


def wait_until(found: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    while not found() and process.poll() is None:
        time.sleep(0.1)


def of(cluster: RayCluster, prefix: str, cache: Path) -> dict[str, str]:
    """The environment of a stage whose work the cluster does, with the store below a prefix of the bucket."""
    return {"DYNAMICS_STORE": f"s3://bucket/{prefix}", "DYNAMICS_CACHE": str(cache), "RAY_ADDRESS": cluster.address}


def test_a_cluster_that_loses_a_node_gives_the_bytes_of_one_machine(
    cluster: RayCluster, local: Path, tmp_path: Path
) -> None:
    shared = repository(tmp_path / "shared", name="ray")
    environment = of(cluster, "node", tmp_path / "driver")
    for stage in STAGES:
        process = start(shared, stage, **environment)
        if stage == "simulate":
            wait_until(lambda: bool(list(cluster.caches[0].glob("??/*/contacts.parquet"))), process)
            cluster.kill_node(0)
        finish(process)
    assert hash_files(shared / "data") == hash_files(local / "data")

    again = repository(tmp_path / "again", workers=1)  # another machine with an empty disk
    for stage in STAGES:
        fresh = {"DYNAMICS_STORE": environment["DYNAMICS_STORE"], "DYNAMICS_CACHE": str(tmp_path / "fresh")}
        assert f"{CLIPS} shards, 0 computed, {CLIPS} from the store" in finish(start(again, stage, **fresh))
    assert hash_files(again / "data") == hash_files(local / "data")

    more = repository(tmp_path / "more", clips=CLIPS + 1, name="ray")
    for stage in STAGES:
        assert f"{CLIPS + 1} shards, 1 computed, {CLIPS} from the store" in finish(start(more, stage, **environment))


def test_a_cluster_that_loses_its_head_ends_the_run_and_the_next_cluster_goes_on(
    server: S3Server, local: Path, tmp_path: Path
) -> None:
    shared = repository(tmp_path / "shared", name="ray")
    with ray_cluster(tmp_path, server.environment) as first:
        environment = of(first, "head", tmp_path / "driver")
        finish(start(shared, STAGES[0], **environment))
        process = subprocess.Popen(
            [sys.executable, "-c", WAITS],
            cwd=shared,
            env={**os.environ, **environment, "PYTHONPATH": str(shared)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "connected\n"
        first.kill_head()
        said, _ = process.communicate(timeout=60)
        assert process.returncode == 2, said
        assert said.splitlines()[-1].startswith("error: the head of the Ray cluster"), said
    with ray_cluster(tmp_path / "next", server.environment) as second:
        environment["RAY_ADDRESS"] = second.address
        assert f"{CLIPS} shards, 0 computed" in finish(start(shared, STAGES[0], **environment))
        for stage in STAGES[1:]:
            finish(start(shared, stage, **environment))
    assert hash_files(shared / "data") == hash_files(local / "data")
