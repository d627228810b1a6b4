"""The default graph on a Ray cluster of three nodes, of which one is killed in the middle of the longest stage.

What it ends with is compared with dvc.lock, which `make repro` wrote with the executor `local`: so the code must be
that of dvc.lock, and the processor of the same kind with as many cores, since a training's rounding depends on its
threads. `make test-machines` has three stages of it (tests/shards/test_cluster.py).
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from campaign import FULL
from ray_cluster import RayCluster, ray_cluster
from ruamel.yaml import YAML

from pipeline.shards.code_hash import ROOT
from pipeline.shards.numeric_threads import thread_variables

pytestmark = [
    pytest.mark.campaign,
    pytest.mark.skipif(not os.environ.get(FULL), reason="the whole default graph: 15 minutes of two cores"),
]

LONGEST = "fit@id"  # a node is killed when the first of its shards is done
WITH_TIMES = ("reports/times.md", "reports/index.html")  # which differ between equal runs


def clone(folder: Path) -> Path:
    """The committed code, graph and data of this repository, to be run on a cluster, and nothing computed."""
    subprocess.run(["git", "clone", "-q", ROOT, folder], check=True)
    (folder / "dvc.lock").unlink()
    parameters = YAML()
    params = parameters.load(folder / "params.yaml")
    params["executor"]["name"] = "ray"
    parameters.dump(params, folder / "params.yaml")
    return folder


def entries(lock: Path) -> dict[str, Any]:
    """By stage: its command, and the hashes of what it read and wrote."""
    stages = YAML(typ="safe").load(lock)["stages"]
    for entry in stages.values():
        entry["outs"] = [out for out in entry.get("outs", []) if out["path"] not in WITH_TIMES]
    return stages


def kill_in_the_middle(stage: str, cluster: RayCluster, process: subprocess.Popen[str], log: Path, store: Path) -> None:
    """Kill a node as soon as the first shard of a stage is in the store."""

    def shards() -> int:
        return len(list(store.glob("??/*/shard.json")))

    def waits(pause_s: float) -> bool:
        assert process.poll() is None, log.read_text()
        time.sleep(pause_s)
        return True

    while f"Running stage '{stage}'" not in log.read_text() and waits(1.0):
        pass
    before = shards()
    while shards() == before and waits(0.2):
        pass
    cluster.kill_node(0)


def test_the_default_graph_on_a_cluster_that_loses_a_node_gives_the_hashes_of_one_machine(tmp_path: Path) -> None:
    folder, store, log = clone(tmp_path / "clone"), tmp_path / "store", tmp_path / "log.txt"
    unset = ("PYTHONPATH", *thread_variables(1))
    own = {name: value for name, value in os.environ.items() if name not in unset}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    began = time.monotonic()
    with ray_cluster(tmp_path / "caches", {}, head_cpus=1) as cluster, log.open("w") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "dvc", "repro"],
            cwd=folder,
            env={**own, "PATH": path, "RAY_ADDRESS": cluster.address, "DYNAMICS_STORE": str(store)},
            stdout=said,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            kill_in_the_middle(LONGEST, cluster, process, log, store)
            process.wait()
        finally:
            process.kill()
    assert process.returncode == 0, log.read_text()
    found, expected = entries(folder / "dvc.lock"), entries(ROOT / "dvc.lock")
    different = [stage for stage in expected if found.get(stage) != expected[stage]]
    assert different == [], f"other hashes than dvc.lock: {', '.join(different)}"
    print(f"{len(found)} stages, {time.monotonic() - began:.0f} s, one node killed in {LONGEST}")
