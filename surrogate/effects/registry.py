"""All effects, in the order in which results list them. To add one: write its file and enter it here."""

from surrogate.effects.acceleration_noise import ACCELERATION_NOISE
from surrogate.effects.base import Effect
from surrogate.effects.blockage import BLOCKAGE
from surrogate.effects.cooperative_yielding import COOPERATIVE_YIELDING
from surrogate.effects.driver_heterogeneity import DRIVER_HETEROGENEITY
from surrogate.effects.gap_sensor_bias import GAP_SENSOR_BIAS
from surrogate.effects.grade import GRADE
from surrogate.effects.heavy_vehicles import HEAVY_VEHICLES
from surrogate.effects.keep_right import KEEP_RIGHT
from surrogate.effects.lane_change_duration import LANE_CHANGE_DURATION
from surrogate.effects.lane_change_relaxation import LANE_CHANGE_RELAXATION
from surrogate.effects.local_speed_reduction import LOCAL_SPEED_REDUCTION
from surrogate.effects.memory import MEMORY
from surrogate.effects.multi_anticipation import MULTI_ANTICIPATION
from surrogate.effects.platooned_arrivals import PLATOONED_ARRIVALS
from surrogate.effects.ramp_inflow_error import RAMP_INFLOW_ERROR
from surrogate.effects.reaction_delay import REACTION_DELAY
from surrogate.effects.rubbernecking import RUBBERNECKING
from surrogate.effects.sensor_latency import SENSOR_LATENCY
from surrogate.effects.sensor_noise import SENSOR_NOISE
from surrogate.effects.sensor_range import SENSOR_RANGE
from surrogate.effects.slow_start import SLOW_START
from surrogate.effects.subject_actuation_lag import SUBJECT_ACTUATION_LAG

EFFECTS: tuple[Effect, ...] = (
    REACTION_DELAY,
    MULTI_ANTICIPATION,
    ACCELERATION_NOISE,
    DRIVER_HETEROGENEITY,
    MEMORY,
    SLOW_START,
    LANE_CHANGE_RELAXATION,
    COOPERATIVE_YIELDING,
    LANE_CHANGE_DURATION,
    KEEP_RIGHT,
    GRADE,
    LOCAL_SPEED_REDUCTION,
    HEAVY_VEHICLES,
    PLATOONED_ARRIVALS,
    RAMP_INFLOW_ERROR,
    BLOCKAGE,
    RUBBERNECKING,
    GAP_SENSOR_BIAS,
    SENSOR_NOISE,
    SENSOR_LATENCY,
    SENSOR_RANGE,
    SUBJECT_ACTUATION_LAG,
)
EFFECT_NAMES = tuple(effect.name for effect in EFFECTS)
EFFECT_NUMBER = {name: number for number, name in enumerate(EFFECT_NAMES)}


class UnknownEffectError(ValueError):
    """A name that no effect has."""

    def __init__(self, name: str) -> None:
        """List the known ones."""
        super().__init__(f"unknown effect '{name}'; known are {', '.join(EFFECT_NAMES)}")


def effect_named(name: str) -> Effect:
    """Return an effect.

    Raises:
        UnknownEffectError: there is none of that name.
    """
    if name not in EFFECT_NUMBER:
        raise UnknownEffectError(name)
    return EFFECTS[EFFECT_NUMBER[name]]
