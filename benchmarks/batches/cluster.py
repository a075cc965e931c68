"""Two nodes of Ray as processes of this machine, one of which can be killed."""

from __future__ import annotations

import os
from types import TracebackType
from typing import Any, Self

ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_raylet_start_wait_time_s": "300",  # a busy machine
    "RAY_gcs_server_request_timeout_seconds": "120",
}


class LocalCluster:
    """A head node and a second node, each with one core; a context manager. Needs Ray.

    Attributes:
        address: for `fling batch --ray` or `python -m jobs batch --ray`.
    """

    def __init__(self) -> None:
        os.environ.update(ENVIRONMENT)
        from ray.cluster_utils import Cluster

        head = {"num_cpus": 1, "include_dashboard": False}
        self._cluster: Any = Cluster(initialize_head=True, head_node_args=head)
        self._second = self._cluster.add_node(num_cpus=1)
        self.address = str(self._cluster.address)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._cluster.shutdown()

    def kill_node(self) -> None:
        """Kills the second node with all its workers, and starts another."""
        self._cluster.remove_node(self._second, allow_graceful=False)
        self._second = self._cluster.add_node(num_cpus=1)
