"""One lane along the subject vehicle's route."""

from dataclasses import dataclass

LaneKey = tuple[str, int]


@dataclass(frozen=True)
class RouteLane:
    """One lane on the carriageway or on a ramp."""

    edge: str  # SUMO edge id
    index: int  # lane index in the edge, 0 = rightmost
    start_m: float  # where the edge begins on the route's axis
    end_m: float  # where it ends
    speed_limit_mps: float  # legal limit
    successors: tuple[LaneKey, ...]  # lanes reached without a lane change
    is_acceleration: bool  # whether the network marks it as an acceleration lane
    is_open: bool = True  # whether all vehicle classes of the scenario may use it
    # lane that it leads into together with a lane of another edge, which goes on there instead
    merges_into: LaneKey | None = None

    @property
    def leads_to(self) -> tuple[LaneKey, ...]:
        """Lanes that vehicles on it go on in, whether or not they change lane for that at its end."""
        return self.successors or ((self.merges_into,) if self.merges_into else ())

    @property
    def key(self) -> LaneKey:
        """Edge and index."""
        return (self.edge, self.index)

    @property
    def id(self) -> str:
        """SUMO's id."""
        return lane_id(self.key)


def lane_id(key: LaneKey) -> str:
    """SUMO's id of a lane."""
    return f"{key[0]}_{key[1]}"
