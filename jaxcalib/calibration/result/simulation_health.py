"""Whether a simulator could run what the parameters ask for."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxcalib.calibration.result.result import SimulationHealth, rounded
from sim_adapters.interface import RunOutcome
from sim_adapters.shared_runs import shared_runs


def health_of(outcomes: Sequence[RunOutcome]) -> SimulationHealth:
    """Return the health of runs, at least one; drives that shared a run count as one, but for those unfinished."""
    numbers_of_runs = shared_runs([outcome.request for outcome in outcomes])
    runs = [outcomes[numbers[0]] for numbers in numbers_of_runs]
    return SimulationHealth(
        runs=len(runs),
        failed=sum(not all(outcomes[number].status.is_ok for number in numbers) for numbers in numbers_of_runs),
        unfinished=sum(outcome.status.is_ok and not outcome.subject_left for outcome in outcomes),
        collisions=sum(outcome.num_collisions for outcome in runs),
        teleports=sum(outcome.num_teleports for outcome in runs),
        subject_overlaps=sum(outcome.num_subject_overlaps for outcome in runs),
        backlog_share=rounded(float(np.mean([outcome.backlog_share for outcome in runs]))) or 0.0,
    )


def unfinished_warnings(health: Mapping[str, SimulationHealth]) -> list[str]:
    """Return a sentence for each group of runs in which drives did not reach their destination.

    Args:
        health: of runs, by what they were for.
    """
    return [
        f"Drives that did not reach their destination before their run ended: {one.unfinished} in {one.runs} runs "
        f"({name}); they count up to there. A jam that does not dissolve, or a lane that leads nowhere?"
        for name, one in health.items()
        if one.unfinished
    ]


def missing_warnings(runs: Mapping[str, Sequence[RunOutcome]]) -> list[str]:
    """Return a sentence for each group of runs on held-out drives of which none succeeded.

    Args:
        runs: on held-out drives, by whose values they have.
    """
    return [
        f"All {len(outcomes)} runs on held-out drives failed with {name} values in SUMO: "
        f"{'; '.join(sorted({outcome.status.value for outcome in outcomes}))}. So their errors are not told: do these "
        "values fill the road by then? More of the drives may have to be drives to fit."
        for name, outcomes in runs.items()
        if outcomes and not any(outcome.status.is_ok for outcome in outcomes)
    ]
