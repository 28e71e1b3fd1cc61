"""Who waits for a cluster's runs waits for SUMO, and the profile says so."""

import time
from typing import Any

from jaxcalib.cluster.cluster_workers import ClusterRun
from sim_adapters.activity import Activity, listening

WAITS_S = 0.05


class SlowCluster:
    """Gives its only task after a while."""

    def next_of(self, ended: Any) -> Any:
        """Wait."""
        time.sleep(WAITS_S)
        return ended

    def result_of(self, task: Any, name: str) -> str:
        """Say what was asked for."""
        return f"{name}: {task}"


def test_time_in_which_a_command_waits_for_a_cluster_counts_as_waiting_for_sumo() -> None:
    cluster: Any = SlowCluster()
    ended: Any = "ended"
    with listening() as ledger:
        assert ClusterRun(cluster, ended, cluster, "seed 3").result() == "seed 3: ended"
    assert ledger.here_s[Activity.WAITING] >= WAITS_S
