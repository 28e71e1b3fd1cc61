"""The road along the subject vehicle's route, as arrays.

Lanes that connect to one another form a *track*; tracks that never overlap share a *row*. Along a row the position
grows downstream and has no gaps that matter: a vehicle changes row only by changing lane. An on-ramp and the
acceleration lane it leads into are one track, and so are a deceleration lane and its off-ramp. Row 0 lies furthest to
the right. All tables are indexed by (row, segment); a segment is a stretch on which nothing changes in any row.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class Road(eqx.Module):
    """Static geometry. Positions are metres along the subject vehicle's route; ramps use the same axis."""

    cell_origin_m: Float[Array, ""]  # position at which the first cell begins (ramps may begin before 0)
    cell_length_m: Float[Array, ""]  # length of the lookup cells
    cell_segment: Int[Array, " cell"]  # segment in which each cell begins
    segment_end_m: Float[Array, " segment"]  # where each segment ends; inf for the last
    speed_limit_mps: Float[Array, "row segment"]  # legal limit
    # where the next lower limit downstream in this row begins; inf where there is none
    slow_position_m: Float[Array, "row segment"]
    slow_limit_mps: Float[Array, "row segment"]  # that lower limit
    left_row: Int[Array, "row segment"]  # row that a vehicle may change to on the left; -1 where there is none
    right_row: Int[Array, "row segment"]  # the same on the right
    # lane changes to the lane that the route needs, left positive (SUMO's bestLaneOffset)
    best_lane_offset: Int[Array, "destination row segment"]
    # how far the route can be followed from this lane, as SUMO counts it
    continuation_end_m: Float[Array, "destination row segment"]
    end_position_m: Float[Array, " end"]  # the distinct places at which a track stops being of use to some route
    # which of these ends the stretch that the route can follow in this row without a lane change
    track_end: Int[Array, "destination row segment"]
    # where a vehicle that fails to leave this lane must stand; inf where the route ends first
    stop_position_m: Float[Array, "destination row segment"]
    destination_end_m: Float[Array, " destination"]  # where vehicles with this destination leave the road
    # whether the subject vehicle's sensors see this piece of the row (ramps are not seen)
    is_carriageway: Bool[Array, "row segment"]
    # whether the lane goes on to a road that is not the continuation of the carriageway
    leads_elsewhere: Bool[Array, "row segment"]
    edge_start_m: Float[Array, " segment"]  # where the edge of the carriageway begins that this segment belongs to
    edge_length_m: Float[Array, " segment"]  # length of that edge
    num_lanes: Float[Array, " segment"]  # lanes of the carriageway in this segment, auxiliary lanes included
    borders_per_cell: int = eqx.field(static=True)  # borders of segments within one cell, at most

    @property
    def num_rows(self) -> int:
        """Number of rows."""
        return self.speed_limit_mps.shape[0]

    @property
    def num_segments(self) -> int:
        """Number of segments."""
        return self.speed_limit_mps.shape[1]

    def segment_at(self, position_m: Float[Array, "..."]) -> Int[Array, "..."]:
        """Return the segment of each position: that in which its cell begins, or one behind it."""
        cell = ((position_m - self.cell_origin_m) / self.cell_length_m).astype(jnp.int32)
        cell = jnp.clip(cell, 0, self.cell_segment.shape[0] - 1)
        segment = self.cell_segment.at[cell].get(mode="promise_in_bounds")
        for _ in range(self.borders_per_cell):  # the last segment ends nowhere, so this never runs off the end
            segment = segment + (position_m >= self.segment_end_m.at[segment].get(mode="promise_in_bounds"))
        return segment
