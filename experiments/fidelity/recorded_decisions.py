"""Recorded lane-change decisions as the situations that the surrogate's lane-change models judge."""

from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.vehicle.lane_change_model import RouteNeed, Side
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass

TABLE = Path("freeway", "ngsim_lane_change_gaps.csv.gz")
LENGTH_M = 5.0  # the table has no lengths; median of the vehicles of NGSIM US-101, and SUMO's default
SPEED_LIMIT_MPS = 65 * 0.44704  # of both freeways
FAR_M = 10_000.0


@dataclass(frozen=True)
class RecordedDecisions:
    """Drivers who are about to change lane, and whether they went in front of the next vehicle there or let it pass.

    Distances are between front bumpers; nan where nobody is.
    """

    site: np.ndarray  # freeway
    is_accepted: Bool[np.ndarray, " decision"]  # whether the driver took the gap in front of the follower
    speed_mps: Float[np.ndarray, " decision"]  # his speed
    follower_mps: Float[np.ndarray, " decision"]  # speed of the next vehicle behind on the target lane
    leader_mps: Float[np.ndarray, " decision"]  # speed of the next vehicle ahead there
    own_leader_mps: Float[np.ndarray, " decision"]  # speed of the next vehicle ahead on the own lane
    follower_m: Float[np.ndarray, " decision"]  # how far the follower is behind, < 0 if he is ahead
    leader_m: Float[np.ndarray, " decision"]  # how far the leader is ahead, < 0 if he is behind
    own_leader_m: Float[np.ndarray, " decision"]  # the same on the own lane


def read_decisions(data: Path) -> RecordedDecisions:
    """Return the decisions of NGSIM's I-80 and US-101 (45 minutes each)."""
    table = pd.read_csv(data / TABLE)
    speed = table["u0_mps"].to_numpy(float)

    def other(name: str) -> np.ndarray:
        return np.maximum(speed - table[f"du_{name}_mps"].to_numpy(float), 0.0)

    def ahead(name: str) -> np.ndarray:
        return np.where(table[f"has_{name}"] == 1, -table[f"dx_{name}_m"].to_numpy(float), np.nan)

    return RecordedDecisions(
        site=table["site"].str.split(" ").str[0].to_numpy(str),
        is_accepted=table["label_merge_front"].to_numpy(float) == 1.0,
        speed_mps=speed,
        follower_mps=other("lag"),
        leader_mps=other("lead_target"),
        own_leader_mps=other("lead_orig"),
        follower_m=table["dx_lag_m"].to_numpy(float),
        leader_m=ahead("lead_target"),
        own_leader_m=ahead("lead_orig"),
    )


def situations(decisions: RecordedDecisions, drivers: VehicleClass) -> tuple[Ego, Side, Following]:
    """Return what a lane-change model is asked if all these drivers are of one class.

    Accelerations are not recorded and taken as 0; the route demands nothing.
    """
    number = len(decisions.speed_mps)
    model = drivers.car_following
    zero, far = jnp.zeros(number), jnp.full(number, FAR_M)
    limit = jnp.full(number, SPEED_LIMIT_MPS)
    same_class = jnp.zeros(number, jnp.int32)
    yes = jnp.ones(number, bool)
    nothing = RouteNeed(best_lane_offset=same_class, remaining_m=far, from_edge_m=far, occupied_m=zero)

    def gap_m(distance_m: np.ndarray) -> jnp.ndarray:
        return jnp.asarray(np.where(np.isnan(distance_m), np.inf, distance_m - LENGTH_M)) - model.jam_gap_m

    ego = Ego(
        speed_mps=jnp.asarray(decisions.speed_mps),
        acceleration_mps2=zero,
        max_speed_mps=limit,
        speed_limit_mps=limit,
        length_m=jnp.full(number, LENGTH_M),
        lane_length_m=far,
        leader_exists=jnp.asarray(~np.isnan(decisions.own_leader_m)),
        leader_gap_m=gap_m(decisions.own_leader_m),
        leader_speed_mps=jnp.asarray(decisions.own_leader_mps),
        leader_acceleration_mps2=zero,
        leader_max_speed_mps=limit,
        leader_class=same_class,
        need=nothing,
    )
    side = Side(
        is_open=yes,
        row=same_class,
        leader_entry=same_class,
        leader_exists=jnp.asarray(~np.isnan(decisions.leader_m)),
        leader_gap_m=gap_m(decisions.leader_m),
        leader_speed_mps=jnp.asarray(decisions.leader_mps),
        leader_acceleration_mps2=zero,
        leader_max_speed_mps=limit,
        leader_class=same_class,
        follower_entry=same_class,
        follower_exists=yes,
        follower_gap_m=gap_m(decisions.follower_m),
        follower_speed_mps=jnp.asarray(decisions.follower_mps),
        follower_acceleration_mps2=zero,
        follower_max_speed_mps=limit,
        follower_class=same_class,
        need=nothing,
        leads_elsewhere=~yes,
    )
    following = Following(
        own=CarFollowingMix((model,), same_class),
        lengths_m=(jnp.asarray(LENGTH_M),),
        jam_gap_m=jnp.broadcast_to(model.jam_gap_m, number),
        time_gap_s=jnp.broadcast_to(model.time_gap_s, number),
        max_acceleration_mps2=jnp.broadcast_to(model.max_acceleration_mps2, number),
        max_deceleration_mps2=jnp.broadcast_to(model.max_deceleration_mps2, number),
    )
    return ego, side, following
