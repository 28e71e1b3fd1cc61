"""Whether SUMO could run what the parameters ask for."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.result import SimulationHealth, rounded
from sim_adapters.interface import RunOutcome
from sim_adapters.shared_runs import shared_runs


def health_of(outcomes: Sequence[RunOutcome]) -> SimulationHealth:
    """Return the health of runs, at least one; drives that shared a run count as one."""
    numbers_of_runs = shared_runs([outcome.request for outcome in outcomes])
    runs = [outcomes[numbers[0]] for numbers in numbers_of_runs]
    return SimulationHealth(
        runs=len(runs),
        failed=sum(not all(outcomes[number].status.is_ok for number in numbers) for numbers in numbers_of_runs),
        collisions=sum(outcome.num_collisions for outcome in runs),
        teleports=sum(outcome.num_teleports for outcome in runs),
        subject_overlaps=sum(outcome.num_subject_overlaps for outcome in runs),
        backlog_share=rounded(float(np.mean([outcome.backlog_share for outcome in runs]))) or 0.0,
    )
