"""A Ray cluster of three nodes on this machine, each a process tree of its own with a cache of its own."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

SETTINGS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}


class RayCluster:
    """A head and two nodes with one core each. No node has a data/.

    Args:
        caches: The folder for the nodes' caches.
        head_cpus: How many shards the head computes at a time.
    """

    def __init__(self, caches: Path, head_cpus: int) -> None:
        from ray.cluster_utils import Cluster

        self.caches = [caches / f"node{k}" for k in range(2)]
        head = {"num_cpus": head_cpus, "include_dashboard": False}
        self._cluster: Any = Cluster(initialize_head=True, head_node_args=head)
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
def ray_cluster(caches: Path, environment: dict[str, str], head_cpus: int = 0) -> Iterator[RayCluster]:
    """A cluster whose nodes have these variables."""
    pytest.importorskip("ray", reason='Ray is not installed: pip install -e ".[ray]"')
    with pytest.MonkeyPatch.context() as own:
        for name, value in {**SETTINGS, **environment}.items():
            own.setenv(name, value)
        cluster = RayCluster(caches, head_cpus)
        try:
            yield cluster
        finally:
            cluster.stop()
