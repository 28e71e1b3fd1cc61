"""Whether SUMO could run what the parameters ask for."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.result import SimulationHealth, rounded
from sim_adapters.interface import RunOutcome


def health_of(outcomes: Sequence[RunOutcome]) -> SimulationHealth:
    """Return the health of runs, at least one."""
    return SimulationHealth(
        runs=len(outcomes),
        failed=sum(not outcome.status.is_ok for outcome in outcomes),
        collisions=sum(outcome.num_collisions for outcome in outcomes),
        teleports=sum(outcome.num_teleports for outcome in outcomes),
        subject_overlaps=sum(outcome.num_subject_overlaps for outcome in outcomes),
        backlog_share=rounded(float(np.mean([outcome.backlog_share for outcome in outcomes]))) or 0.0,
    )
