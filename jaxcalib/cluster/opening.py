"""Where a command's runs are made: on this machine, or on a cluster that the command line names."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from jaxcalib.errors import CaseError
from sim_adapters.sumo.workers import SumoWorkers

if TYPE_CHECKING:  # dask may not be installed
    from jaxcalib.cluster.connection import Cluster


def connect(address: str) -> "Cluster":
    """Return a connection to the scheduler at an address; close it after use.

    Raises:
        CaseError: dask is not installed.
        ResourceError: nobody answers there, or no worker comes.
    """
    try:
        from jaxcalib.cluster.connection import Cluster
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("distributed", "dask"):
            raise
        raise CaseError("command line", "--cluster", "expected dask; pip install 'jaxcalib[cluster]'.") from None
    return Cluster(address)


@contextmanager
def sumo_workers_at(address: str | None) -> Iterator[SumoWorkers | None]:
    """Open SUMO's workers of a cluster, and leave it behind them; None, for this machine's, without an address.

    Raises:
        CaseError, ResourceError: as `connect`.
    """
    if address is None:
        yield None
        return
    cluster = connect(address)
    from jaxcalib.cluster.cluster_workers import ClusterWorkers

    try:
        yield ClusterWorkers(cluster)
    finally:
        cluster.close()
