"""Every car-following model by name, with its parameters, their ranges and a usual value of each.

To add a model: write its file, enter it here; every law test then runs for it, and `jaxcalib fit-following` fits it.
Ranges are those that calibrations of the model use; a calibration of a SUMO case has its own, in SUMO's names.
"""

from surrogate.car_following.asymmetric_optimal_velocity import AsymmetricOptimalVelocity
from surrogate.car_following.full_velocity_difference import FullVelocityDifference
from surrogate.car_following.gazis_herman_rothery import GazisHermanRothery
from surrogate.car_following.gipps import Gipps
from surrogate.car_following.idm import Idm
from surrogate.car_following.improved_idm import ImprovedIdm
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.wiedemann99 import Wiedemann99Sumo
from surrogate.car_following.wiedemann99_vissim import Wiedemann99Vissim
from surrogate.vehicle.car_following_model import CarFollowingModel
from surrogate.vehicle.model_entry import ModelEntry, Parameter, find


def car_following_model(name: str) -> ModelEntry[CarFollowingModel]:
    """Return a model of the registry.

    Raises:
        UnknownModelError: there is no such model.
    """
    return find(CAR_FOLLOWING_MODELS, name, "car-following")


_EMERGENCY = {"emergency_deceleration_mps2": 9.0}
_GAPS = (Parameter("jam_gap_m", 2.0, 0.5, 6.0), Parameter("time_gap_s", 1.2, 0.3, 3.5))
_ACCELERATION = Parameter("max_acceleration_mps2", 1.5, 0.3, 4.0)
_DECELERATION = Parameter("max_deceleration_mps2", 2.0, 0.5, 6.0)
_BASIC = (*_GAPS, _ACCELERATION, _DECELERATION)
# what a model's own rules do not use, but stops and lane changes do
_STOPS = {"jam_gap_m": 2.0, "time_gap_s": 1.2, "max_deceleration_mps2": 3.0}
_W99 = (
    Parameter("cc0_standstill_gap_m", 1.5, 0.5, 5.0),
    Parameter("cc1_time_gap_s", 0.9, 0.3, 3.0),
    Parameter("cc2_following_variation_m", 4.0, 0.5, 15.0),
    Parameter("cc3_following_threshold_s", -8.0, -30.0, -2.0),
    Parameter("cc4_negative_speed_threshold_mps", -0.35, -2.0, -0.05),
    Parameter("cc5_positive_speed_threshold_mps", 0.35, 0.05, 2.0),
    Parameter("cc6_oscillation_speed_dependency", 11.44, 0.5, 20.0),
    Parameter("cc7_oscillation_acceleration_mps2", 0.25, 0.02, 1.0),
    Parameter("cc8_standstill_acceleration_mps2", 2.5, 0.5, 4.0),
    Parameter("cc9_acceleration_at_80kmh_mps2", 1.5, 0.3, 3.0),
)

CAR_FOLLOWING_MODELS: tuple[ModelEntry[CarFollowingModel], ...] = (
    ModelEntry(
        "idm", "intelligent driver model", Idm,
        (*_BASIC, Parameter("acceleration_exponent", 4.0, 1.0, 10.0)), _EMERGENCY,
    ),
    ModelEntry(
        "iidm", "improved intelligent driver model", ImprovedIdm,
        _BASIC, _EMERGENCY | {"acceleration_exponent": 4.0, "coolness": 0.0},
    ),
    ModelEntry(
        "acc", "improved IDM with the constant-acceleration heuristic", ImprovedIdm,
        (*_BASIC, Parameter("coolness", 0.99, 0.0, 1.0)), _EMERGENCY | {"acceleration_exponent": 4.0},
    ),
    ModelEntry("krauss", "Krauss' model as SUMO computes it, without dawdling", Krauss, _BASIC,
               _EMERGENCY | {"imperfection": 0.0}),
    ModelEntry("w99-sumo128", "Wiedemann 99 as SUMO 1.28 computes it", Wiedemann99Sumo, _W99,
               _EMERGENCY | {"max_deceleration_mps2": 4.5}),
    ModelEntry("w99-vissim", "Wiedemann 99 as VISSIM means it", Wiedemann99Vissim, _W99,
               _EMERGENCY | {"max_deceleration_mps2": 4.5}),
    ModelEntry(
        "gipps", "Gipps' model", Gipps,
        (*_GAPS[:1], Parameter("time_gap_s", 0.8, 0.2, 2.5), _ACCELERATION, _DECELERATION,
         Parameter("leader_deceleration_mps2", 3.0, 0.5, 8.0)),
        _EMERGENCY,
    ),
    ModelEntry(
        "ghr", "model of Gazis, Herman and Rothery", GazisHermanRothery,
        (Parameter("sensitivity", 1.1, 0.01, 10.0), Parameter("speed_exponent", 0.9, -1.0, 2.0),
         Parameter("gap_exponent", 1.0, -1.0, 3.0), _ACCELERATION),
        _EMERGENCY | _STOPS,
    ),
    ModelEntry(
        "fvd", "full velocity difference model", FullVelocityDifference,
        (_GAPS[0], Parameter("relaxation_rate_1ps", 0.4, 0.02, 2.0),
         Parameter("speed_difference_rate_1ps", 0.6, 0.0, 2.0), Parameter("interaction_gap_m", 120.0, 20.0, 200.0),
         Parameter("gap_scale_m", 15.0, 2.0, 60.0), Parameter("form_factor", 1.5, 0.0, 4.0), _ACCELERATION),
        _EMERGENCY | {name: _STOPS[name] for name in ("time_gap_s", "max_deceleration_mps2")},
    ),
    ModelEntry(
        "aovrv", "asymmetric optimal velocity relative velocity model", AsymmetricOptimalVelocity,
        (*_GAPS, Parameter("accelerating_gap_rate_1ps2", 0.08, 0.001, 0.5),
         Parameter("accelerating_speed_rate_1ps", 0.3, 0.0, 2.0),
         Parameter("decelerating_gap_rate_1ps2", 0.09, 0.001, 0.5),
         Parameter("decelerating_speed_rate_1ps", 0.5, 0.0, 2.0), _ACCELERATION),
        _EMERGENCY | {"cruise_rate_1ps": 0.4, "max_deceleration_mps2": 3.0},
    ),
)  # fmt: skip
