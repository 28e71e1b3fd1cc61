"""What a field is made of: everything that an effect may change, before SUMO runs."""

from dataclasses import dataclass, field, replace

Attributes = dict[str, str]


@dataclass(frozen=True)
class DriverType:
    """A vType of the background traffic."""

    share: float  # of the vehicles of every flow, or of those of its entrance
    attributes: Attributes  # of SUMO's vType
    parameters: Attributes = field(default_factory=dict)  # generic parameters (`<param>`) of the vType
    entrances: tuple[str, ...] | None = None  # inputs with such drivers; none means all


@dataclass(frozen=True)
class StandingVehicle:
    """A vehicle that stands in a lane; it drives there like any other."""

    lane: str  # SUMO lane id
    position_m: float  # on the lane
    depart_s: float  # when it enters the road
    until_s: float  # when it drives on


@dataclass(frozen=True)
class SpeedSign:
    """SUMO's variable speed sign."""

    lanes: tuple[str, ...]  # SUMO lane ids
    speed_mps: float  # shown from `from_s` to `to_s`
    from_s: float = 0.0  # begin
    to_s: float | None = None  # end; none for ever


@dataclass(frozen=True)
class SensorFault:
    """What the sensors do to the log; zero is a perfect sensor."""

    bias: float = 0.0  # factor - 1 on the distance along the road
    noise: float = 0.0  # standard deviation in m (distance) and m/s (speed), white
    latency_s: float = 0.0  # objects are reported as they were this long ago
    range_loss: float = 0.0  # share of the range lost; a tenth of it is the chance to lose an object in a frame
    swaps_per_min: float = 0.0  # exchanges of the ids of two neighbours
    clock_drift: float = 0.0  # objects' clock runs fast by this share
    map_offset_m: float = 0.0  # error of the subject vehicle's position, to the east


@dataclass(frozen=True)
class FieldSpec:
    """A field."""

    drivers: tuple[DriverType, ...]  # types of the background's drivers; shares sum to 1
    subject: Attributes  # attributes of the subject vehicle's vType
    inputs_vehph: dict[str, float]  # true inflow of each entrance
    platoon_share: float = 0.0  # share of the first entrance's vehicles that arrive in platoons
    platoon_size: float = 14.0  # mean number of vehicles in a platoon
    # inflows grow linearly by this share of themselves, from the begin to the end, with the same mean
    surge: float = 0.0
    speed_signs: tuple[SpeedSign, ...] = ()  # variable speed signs
    standing: tuple[StandingVehicle, ...] = ()  # vehicles that stand
    options: tuple[str, ...] = ()  # command-line options of SUMO
    sensor: SensorFault = field(default_factory=SensorFault)  # what the sensors do

    def with_all_drivers(self, attributes: Attributes, parameters: Attributes | None = None) -> "FieldSpec":
        """Return the field with these attributes and generic parameters of every background driver."""
        drivers = tuple(
            replace(
                driver, attributes=driver.attributes | attributes, parameters=driver.parameters | (parameters or {})
            )
            for driver in self.drivers
        )
        return replace(self, drivers=drivers)
