"""One run with several subject vehicles: most of a run is the traffic that fills the road before any of them."""

from collections.abc import Hashable, Sequence
from itertools import pairwise

from sim_adapters.interface import NO_DRIVE, DriveStart, RunRequest

LEAST_APART_S = 40.0  # between subject vehicles of one run: they do not see each other unless traffic hardly moves
MOST_PER_RUN = 3  # with more, means would rest on a handful of runs
FURTHER_WORTH = 0.7  # what a further drive of a run tells, in drives with a run of their own; 0.75 measured with jams


def departures_s(request: RunRequest) -> tuple[float, ...]:
    """Return when the subject vehicles of a run depart, in order."""
    return tuple(sorted({request.depart_s, *request.also_depart_s}))


def subject_names(vehicle: str, departs_s: Sequence[float]) -> tuple[str, ...]:
    """Return the ids of a run's subject vehicles, by departure; the first keeps the scenario's own.

    Args:
        vehicle: id of the scenario's subject vehicle.
        departs_s: departures, in order.
    """
    return (vehicle, *(f"{vehicle}.subject{number}" for number in range(1, len(departs_s))))


def shared_runs(requests: Sequence[RunRequest]) -> list[list[int]]:
    """Return the numbers of the requests that one run answers together, in the order of their first ones."""
    found: dict[Hashable, list[list[int]]] = {}
    for number, request in enumerate(requests):
        # a run with one subject vehicle is made as often as it is asked for
        alone = number if not request.also_depart_s else None
        effects = tuple((name, repr(setting)) for name, setting in request.effects.items())
        alike = found.setdefault((request.values, request.seed, departures_s(request), effects, alone), [])
        others = (run for run in alike if all(_go_together(request, requests[other]) for other in run))
        run = next(others, None)
        if run is None:
            alike.append([number])
        else:
            run.append(number)
    return sorted(run for alike in found.values() for run in alike)


def starts_of(requests: Sequence[RunRequest]) -> tuple[DriveStart, ...]:
    """Return the drives of the run that answers requests together, in order.

    Args:
        requests: which differ in whom they ask for; a subject vehicle that none asks for stands for no drive.
    """
    drives = {request.depart_s: request.drive for request in requests}
    return tuple(DriveStart(depart_s, drives.get(depart_s, NO_DRIVE)) for depart_s in departures_s(requests[0]))


def _go_together(one: RunRequest, other: RunRequest) -> bool:
    """Whether one subject vehicle need not stand for two drives."""
    return one.depart_s != other.depart_s or one.drive == other.drive


def drives_worth(num_drives: float, num_runs: float) -> float:
    """Return what drives that share runs tell, in drives with a run of their own."""
    return num_runs + FURTHER_WORTH * (num_drives - num_runs)


def starts_apart(
    starts: Sequence[DriveStart], least_apart_s: float = LEAST_APART_S, most: int = MOST_PER_RUN
) -> list[tuple[DriveStart, ...]]:
    """Return drives dealt to as few runs as keep those of one run apart, as evenly as that allows.

    Args:
        starts: when the drives begin; those that begin at one time never share a run.
        least_apart_s: time between two departures of one run, at least.
        most: drives of one run, at most.
    """
    ordered = sorted(starts)
    for num_runs in range(-(-len(ordered) // most), len(ordered)):
        dealt = [tuple(ordered[first::num_runs]) for first in range(num_runs)]
        if all(later.depart_s - earlier.depart_s >= least_apart_s for run in dealt for earlier, later in pairwise(run)):
            return dealt
    return [(one,) for one in ordered]
