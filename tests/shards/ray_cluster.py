"""A Ray cluster of three nodes on this machine, each a process tree of its own with a cache of its own."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

SETTINGS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}


class RayCluster:
    """The head, which computes nothing, and two nodes with one core each. No node has a data/."""

    def __init__(self, caches: Path) -> None:
        from ray.cluster_utils import Cluster

        self.caches = [caches / f"node{k}" for k in range(2)]
        self._cluster: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
        self.address: str = self._cluster.address
        self._nodes = [
            self._cluster.add_node(num_cpus=1, env_vars={"DYNAMICS_CACHE": str(cache)}) for cache in self.caches
        ]

    def kill_node(self, k: int) -> None:
        """Kill −9 of all processes of a node."""
        self._cluster.remove_node(self._nodes[k], allow_graceful=False)

    def kill_head(self) -> None:
        self._cluster.remove_node(self._cluster.head_node, allow_graceful=False)

    def stop(self) -> None:
        self._cluster.shutdown()


@contextmanager
def ray_cluster(caches: Path, environment: dict[str, str]) -> Iterator[RayCluster]:
    """A cluster whose nodes have these variables."""
    pytest.importorskip("ray", reason='Ray is not installed: pip install -e ".[ray]"')
    with pytest.MonkeyPatch.context() as own:
        for name, value in {**SETTINGS, **environment}.items():
            own.setenv(name, value)
        cluster = RayCluster(caches)
        try:
            yield cluster
        finally:
            cluster.stop()
