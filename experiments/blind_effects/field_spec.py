"""What a field is made of: everything that an effect may change, before SUMO runs."""

from dataclasses import dataclass, field, replace

Attributes = dict[str, str]


@dataclass(frozen=True)
class DriverType:
    """A vType of the background traffic.

    Attributes:
        share: of the vehicles of every flow, or of those of its entrance.
        attributes: of SUMO's vType.
        parameters: generic parameters (`<param>`) of the vType.
        entrances: inputs with such drivers; none means all.
    """

    share: float
    attributes: Attributes
    parameters: Attributes = field(default_factory=dict)
    entrances: tuple[str, ...] | None = None


@dataclass(frozen=True)
class StandingVehicle:
    """A vehicle that stands in a lane; it drives there like any other.

    Attributes:
        lane: SUMO lane id.
        position_m: on the lane.
        depart_s: when it enters the road.
        until_s: when it drives on.
    """

    lane: str
    position_m: float
    depart_s: float
    until_s: float


@dataclass(frozen=True)
class SpeedSign:
    """SUMO's variable speed sign.

    Attributes:
        lanes: SUMO lane ids.
        speed_mps: shown from `from_s` to `to_s`.
        from_s: begin.
        to_s: end; none for ever.
    """

    lanes: tuple[str, ...]
    speed_mps: float
    from_s: float = 0.0
    to_s: float | None = None


@dataclass(frozen=True)
class SensorFault:
    """What the sensors do to the log; zero is a perfect sensor.

    Attributes:
        bias: factor - 1 on the distance along the road.
        noise: standard deviation in m (distance) and m/s (speed), white.
        latency_s: objects are reported as they were this long ago.
        range_loss: share of the range lost; a tenth of it is the chance to lose an object in a frame.
        swaps_per_min: exchanges of the ids of two neighbours.
        clock_drift: objects' clock runs fast by this share.
        map_offset_m: error of the subject vehicle's position, to the east.
    """

    bias: float = 0.0
    noise: float = 0.0
    latency_s: float = 0.0
    range_loss: float = 0.0
    swaps_per_min: float = 0.0
    clock_drift: float = 0.0
    map_offset_m: float = 0.0


@dataclass(frozen=True)
class FieldSpec:
    """A field.

    Attributes:
        drivers: types of the background's drivers; shares sum to 1.
        subject: attributes of the subject vehicle's vType.
        inputs_vehph: true inflow of each entrance.
        platoon_share: share of the first entrance's vehicles that arrive in platoons.
        platoon_size: mean number of vehicles in a platoon.
        surge: inflows grow linearly by this share of themselves, from the begin to the end, with the same mean.
        speed_signs: variable speed signs.
        standing: vehicles that stand.
        options: command-line options of SUMO.
        sensor: what the sensors do.
    """

    drivers: tuple[DriverType, ...]
    subject: Attributes
    inputs_vehph: dict[str, float]
    platoon_share: float = 0.0
    platoon_size: float = 14.0
    surge: float = 0.0
    speed_signs: tuple[SpeedSign, ...] = ()
    standing: tuple[StandingVehicle, ...] = ()
    options: tuple[str, ...] = ()
    sensor: SensorFault = field(default_factory=SensorFault)

    def with_all_drivers(self, attributes: Attributes, parameters: Attributes | None = None) -> "FieldSpec":
        """Return the field with these attributes and generic parameters of every background driver."""
        drivers = tuple(
            replace(one, attributes=one.attributes | attributes, parameters=one.parameters | (parameters or {}))
            for one in self.drivers
        )
        return replace(self, drivers=drivers)
