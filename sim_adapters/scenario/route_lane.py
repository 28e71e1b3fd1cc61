"""One lane along the subject vehicle's route."""

from dataclasses import dataclass

LaneKey = tuple[str, int]


@dataclass(frozen=True)
class RouteLane:
    """One lane on the carriageway or on a ramp.

    Attributes:
        edge: SUMO edge id.
        index: lane index in the edge, 0 = rightmost.
        start_m: where the edge begins on the route's axis.
        end_m: where it ends.
        speed_limit_mps: legal limit.
        successors: lanes reached without a lane change.
        is_acceleration: whether the network marks it as an acceleration lane.
        is_open: whether all vehicle classes of the scenario may use it.
        merges_into: lane that it leads into together with a lane of another edge, which goes on there instead.
    """

    edge: str
    index: int
    start_m: float
    end_m: float
    speed_limit_mps: float
    successors: tuple[LaneKey, ...]
    is_acceleration: bool
    is_open: bool = True
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
