"""The logged drive, imposed on the subject vehicle: it is where it was, and the simulated traffic reacts to it.

It reacts to nobody, so it may overlap another vehicle, or drive through it. Such steps are counted; the other vehicle
sees a leader with a negative gap and brakes, and where the two have passed each other they change places.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.inflow.newcomers import Entrants
from surrogate.road.road import Road
from surrogate.road.traffic_state import TrafficState, VehicleArrays, with_changes
from surrogate.vehicle.lane_change_model import LEFT, STAY, LaneChangeDecision, Reason
from surrogate.xla.gather import take


class LoggedMotion(eqx.Module):
    """Logged drives, one sample for each step of the simulation from its beginning on."""

    position_m: Float[Array, "drive step"]  # front bumper along the route
    speed_mps: Float[Array, "drive step"]
    row: Int[Array, "drive step"]  # row of the road at the next frame
    first_step: Int[Array, " drive"]  # step at whose beginning the log begins
    num_steps: Int[Array, " drive"]  # number of samples; later ones are filled up
    log: Int[Array, ""]  # which of the drives this run repeats

    def at(self, step: Int[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
        """Return position, speed and row at the beginning of a step."""
        last = take(self.num_steps, self.log) - 1
        sample = jnp.clip(step - take(self.first_step, self.log), 0, last) + self.log * self.position_m.shape[1]
        return tuple(take(table.reshape(-1), sample) for table in (self.position_m, self.speed_mps, self.row))

    def is_over(self, step: Int[Array, ""]) -> Bool[Array, ""]:
        """Whether the log has ended before a step."""
        return step - take(self.first_step, self.log) >= take(self.num_steps, self.log)


def impose(
    motion: LoggedMotion,
    vehicles: VehicleArrays,
    is_subject: Bool[Array, " vehicle"],
    step: Int[Array, ""],
    step_s: float,
) -> VehicleArrays:
    """Return the vehicles with the subject vehicle where its log has it at the beginning of `step`."""
    position_m, speed_mps, _ = motion.at(step)
    _, before_mps, _ = motion.at(step - 1)
    acceleration = (speed_mps - before_mps) / step_s
    return with_changes(
        vehicles,
        position_m=jnp.where(is_subject, position_m, vehicles.position_m),
        speed_mps=jnp.where(is_subject, speed_mps, vehicles.speed_mps),
        acceleration_mps2=jnp.where(is_subject, acceleration, vehicles.acceleration_mps2),
    )


def overlaps(
    vehicles: VehicleArrays, is_subject: Bool[Array, " vehicle"], length_m: Float[Array, " vehicle"]
) -> Int[Array, ""]:
    """Return 1 if another vehicle of its row stands where the subject vehicle is, else 0."""
    here_m = jnp.max(jnp.where(is_subject, vehicles.position_m, -jnp.inf))
    own_m = jnp.max(jnp.where(is_subject, length_m, 0.0))
    row = jnp.max(jnp.where(is_subject, vehicles.row, -1))
    beside = (vehicles.row == row) & vehicles.is_vehicle & ~is_subject
    meets = (vehicles.position_m - length_m < here_m) & (here_m - own_m < vehicles.position_m)
    return jnp.any(beside & meets).astype(jnp.int32)


def staying(decision: LaneChangeDecision, is_subject: Bool[Array, " vehicle"]) -> LaneChangeDecision:
    """Return the decision without the lane change that its class would have the subject vehicle begin."""
    return eqx.tree_at(lambda d: d.direction, decision, jnp.where(is_subject, STAY, decision.direction))


def with_logged_lane(
    decision: LaneChangeDecision, motion: LoggedMotion, state: TrafficState, is_subject: Bool[Array, " vehicle"]
) -> LaneChangeDecision:
    """Return the decision with the subject vehicle going to its logged lane, and to its place among those there."""
    vehicles = state.vehicles
    entry = jnp.argmax(is_subject).astype(jnp.int32)
    _, _, row = motion.at(state.step)
    ahead = _entry_ahead(state, is_subject, take(vehicles.position_m, entry), row, entry)
    moves = is_subject & ((vehicles.row != row) | (ahead != entry - 1))
    return eqx.tree_at(
        lambda d: (d.direction, d.reason, d.entry_ahead, d.target_row),
        decision,
        (
            jnp.where(is_subject, jnp.where(moves, LEFT, STAY), decision.direction),
            jnp.where(is_subject, Reason.SPEED_GAIN, decision.reason).astype(jnp.int32),
            jnp.where(moves, ahead, decision.entry_ahead),
            jnp.where(is_subject, row, decision.target_row),
        ),
    )


def as_logged(candidates: Entrants, motion: LoggedMotion, road: Road, state: TrafficState) -> Entrants:
    """Return the newcomers with the subject vehicle entering where its log begins, whoever is there."""
    position_m, speed_mps, row = motion.at(state.step)
    nobody = jnp.zeros_like(state.vehicles.is_vehicle)
    ahead = _entry_ahead(state, nobody, position_m, row, jnp.asarray(-1))
    begins = (state.step >= take(motion.first_step, motion.log)) & ~motion.is_over(state.step)
    is_subject = candidates.is_subject
    flat = is_subject.reshape(-1)
    limit = take(road.speed_limit_mps.reshape(-1), row * road.num_segments + road.segment_at(position_m))
    newcomers = with_changes(
        candidates.vehicles,
        position_m=jnp.where(flat, position_m, candidates.vehicles.position_m),
        speed_mps=jnp.where(flat, speed_mps, candidates.vehicles.speed_mps),
        row=jnp.where(flat, row, candidates.vehicles.row),
        speed_limit_mps=jnp.where(flat, limit, candidates.vehicles.speed_limit_mps),
    )
    return dataclasses.replace(
        candidates,
        vehicles=newcomers,
        entry_ahead=jnp.where(is_subject, ahead, candidates.entry_ahead),
        enters=jnp.where(is_subject, begins, candidates.enters),
    )


def entry_of_subject(candidates: Entrants, like: Bool[Array, " vehicle"]) -> Bool[Array, " vehicle"]:
    """Return the entry behind which the subject vehicle enters now, if it does; no other vehicle keeps it out."""
    enters = candidates.is_subject & candidates.enters
    return jnp.zeros_like(like).at[jnp.where(enters, candidates.entry_ahead, 0)].max(enters)


def _entry_ahead(
    state: TrafficState,
    is_subject: Bool[Array, " vehicle"],
    position_m: Float[Array, ""],
    row: Int[Array, ""],
    entry: Int[Array, ""],
) -> Int[Array, ""]:
    """Return the entry of the last other vehicle of a row that is further on, or of the row's head.

    The subject vehicle, whose place may be out of order, is not counted.
    """
    vehicles = state.vehicles
    is_ahead = vehicles.is_vehicle & ~is_subject & (vehicles.row == row) & (vehicles.position_m > position_m)
    ahead = take(state.head, row) + jnp.sum(is_ahead, dtype=jnp.int32)
    is_behind_own = (take(vehicles.row, jnp.maximum(entry, 0)) == row) & (entry >= 0) & (ahead >= entry)
    return ahead + is_behind_own
