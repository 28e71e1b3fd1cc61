"""What measures must know of the road: where lanes are, and how it is cut into sections."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from sim_adapters.scenario.ending_lanes import ending_lanes
from sim_adapters.scenario.road_builder import RowMap
from sim_adapters.scenario.scenario import Scenario

LONGEST_SECTION_M = 800.0
SHORTEST_SECTION_M = 300.0


class EndingRows(eqx.Module):
    """Rows that end, or lead off the carriageway, before the road does; the same row may do so several times."""

    row: Float[Array, " ending"]
    begin_m: Float[Array, " ending"]  # where it begins
    end_m: Float[Array, " ending"]  # where it ends
    leads_off: Float[Array, " ending"]  # 1 if it goes on to an exit

    def end_m_at(
        self, row: Num[Array, " object"], position_m: Float[Array, " object"], only_leading_off: bool = False
    ) -> Float[Array, " object"]:
        """Return where the row ends that is at a position; inf where it goes on as long as the road."""
        is_there = (row == self.row[:, None]) & (position_m >= self.begin_m[:, None])
        is_there &= position_m < self.end_m[:, None]
        if only_leading_off:
            is_there &= self.leads_off[:, None] > 0
        return jnp.min(jnp.where(is_there, self.end_m[:, None], jnp.inf), axis=0, initial=jnp.inf)


class ObservedRoad(eqx.Module):
    """The carriageway as the subject vehicle passes along it."""

    section_border_m: Float[Array, " border"]  # borders of the sections, first and last are the ends of the route
    knot_m: Float[Array, " knot"]  # where the number of lanes changes, ends of the route included
    lane_m: Float[Array, " knot"]  # metres of lane upstream of each knot
    # place of each row from right to left; rows that share a stretch of road differ in it
    lateral_order: Float[Array, " row"]
    ending: EndingRows  # rows that must be left in time

    @property
    def num_sections(self) -> int:
        """Number of sections."""
        return self.section_border_m.shape[0] - 1

    @property
    def num_rows(self) -> int:
        """Number of rows."""
        return self.lateral_order.shape[0]

    def lane_m_before(self, position_m: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the metres of lane upstream of each position; constant beyond the ends of the route."""
        length_m, lane_m = jnp.diff(self.knot_m), jnp.diff(self.lane_m)
        passed_m = jnp.clip(position_m[..., None] - self.knot_m[:-1], 0.0, length_m)
        return jnp.sum(passed_m * (lane_m / length_m), axis=-1)

    def lane_m_by_section(self, rear_m: Float[Array, ""], front_m: Float[Array, ""]) -> Float[Array, " section"]:
        """Return the metres of lane between two positions, by section."""
        border = jnp.clip(self.section_border_m, rear_m, front_m)
        return jnp.diff(self.lane_m_before(border))


def observe_road(scenario: Scenario) -> ObservedRoad:
    """Return the observed road of a scenario, with sections that begin and end where vehicles enter or leave."""
    network = scenario.network
    edges = network.main_edges
    knots = [network.edge_start_m(edge) for edge in edges] + [network.length_m]
    lane_count = [network.lane_count[edge] for edge in edges]
    lane_m = np.concatenate([[0.0], np.cumsum(np.diff(knots) * lane_count)])
    return ObservedRoad(
        section_border_m=jnp.asarray(_section_borders(scenario), jnp.float32),
        knot_m=jnp.asarray(knots, jnp.float32),
        lane_m=jnp.asarray(lane_m, jnp.float32),
        lateral_order=jnp.asarray(_lateral_order(scenario.row_map), jnp.float32),
        ending=_ending_rows(scenario.row_map),
    )


def _ending_rows(row_map: RowMap) -> EndingRows:
    lanes = ending_lanes(row_map)
    columns = [[float(value) for value in (one.row, one.begin_m, one.end_m, one.leads_off)] for one in lanes]
    return EndingRows(*jnp.asarray(np.asarray(columns, np.float32).reshape(-1, 4).T))


def _section_borders(scenario: Scenario) -> np.ndarray:
    """Return borders at on- and off-ramps, no closer than the shortest section, long stretches halved."""
    network = scenario.network
    points = set()
    for edge in network.ramp_edges:
        for position in (network.edge_start_m(edge), network.edge_end_m(edge)):
            if 0.0 < position < network.length_m:
                points.add(position)
    borders = [0.0]
    for point in [*sorted(points), network.length_m]:
        stretch = point - borders[-1]
        is_last = point == network.length_m
        if stretch < SHORTEST_SECTION_M and not is_last:
            continue
        if stretch < SHORTEST_SECTION_M and len(borders) > 1:
            borders.pop()
            stretch = point - borders[-1]
        parts = max(1, int(np.ceil(stretch / LONGEST_SECTION_M)))
        borders += [borders[-1] + stretch * (k + 1) / parts for k in range(parts)]
    return np.asarray(borders)


def _lateral_order(row_map: RowMap) -> np.ndarray:
    """For each row how far left it lies: lanes to its right, averaged over where it is on the carriageway.

    Auxiliary lanes shift the numbers of all others; counting from the left of the carriageway removes that shift.
    """
    network = row_map.network
    from_left: dict[int, list[int]] = {}
    for (edge, index), row in row_map.row_of_lane.items():
        if edge in network.main_edges:
            from_left.setdefault(row, []).append(network.lane_count[edge] - 1 - index)
    order = np.zeros(row_map.num_rows)
    for row, lanes_from_left in from_left.items():
        order[row] = -float(np.mean(lanes_from_left))
    return order - order.min()
