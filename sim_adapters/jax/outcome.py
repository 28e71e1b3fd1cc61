"""What a run of the surrogate comes to: its status, and what one of its subject vehicles observed."""

import equinox as eqx
import numpy as np

from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.shared_runs import departures_s
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.loop.run_state import RunRecord

# Steps of overlap allowed in all and per vehicle; SUMO goes on after a collision as well, and Wiedemann's drivers, who
# react late by design, touch now and then where lanes merge.
COLLISION_STEPS_ALLOWED = 100
COLLISION_STEPS_PER_VEHICLE = 1.0


def outcome_of(request: RunRequest, record: RunRecord, wall_s: float, template: WorldTemplate) -> RunOutcome:
    """Return the outcome of a request.

    Args:
        request: what was asked; of several subject vehicles, for which one.
        record: what is left of the run.
        wall_s: its computing time, or this request's share of it.
        template: the scenario.
    """
    record = _of_subject(record, request)
    num_overlaps = int(record.num_subject_overlaps)
    status = Status.OK
    if int(record.num_lost):
        status = Status.OVERFULL
    elif not bool(record.is_finite) or not np.isfinite(record.observed).all():
        status = Status.NONFINITE
    elif not bool(record.subject_entered):
        status = Status.SUBJECT_MISSING
    # stuck before the part of the route that the logs cover: then observers have counted nothing
    elif template.recorded and not np.any(record.observed):
        status = Status.UNSEEN
    # a logged drive overlaps others without being able to help it; both it and its follower count
    elif int(record.num_collisions) - 2 * num_overlaps > _collisions_allowed(record):
        status = Status.COLLIDED
    return RunOutcome(
        request=request,
        status=status,
        observed=record.observed if status.is_ok else None,
        num_arrived=template.of_entrances(np.asarray(record.num_arrived)),
        num_inserted=template.of_entrances(np.asarray(record.num_inserted)),
        num_collisions=int(record.num_collisions),
        num_subject_overlaps=num_overlaps,
        num_vehicle_steps=int(record.num_vehicle_steps),
        subject_left=bool(record.subject_left),
        wall_s=wall_s,
    )


def _of_subject(record: RunRecord, request: RunRequest) -> RunRecord:
    """Return the record of the run with what is left of the subject vehicle that a request asks for."""
    if not record.subject_entered.ndim:
        return record
    number = departures_s(request).index(request.depart_s)
    own = record.observed[number], record.subject_entered[number], record.subject_left[number]
    return eqx.tree_at(lambda one: (one.observed, one.subject_entered, one.subject_left), record, own)


def _collisions_allowed(record: RunRecord) -> float:
    return max(COLLISION_STEPS_ALLOWED, COLLISION_STEPS_PER_VEHICLE * float(np.sum(record.num_inserted)))
