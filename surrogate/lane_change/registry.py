"""Every lane-change model by name, with its parameters, their ranges and a usual value of each.

To add a model: write its file, a subclass of `FreeModel`, and enter it here; `decide.py` then asks it and every law
test runs for it.
"""

from collections.abc import Sequence

from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.mobil import Mobil
from surrogate.lane_change.vissim import Vissim
from surrogate.vehicle.lane_change_model import LaneChangeModel
from surrogate.vehicle.model_entry import ModelEntry, Parameter, find
from surrogate.vehicle.vehicle_class import VehicleClass


def lane_change_model(name: str) -> ModelEntry[LaneChangeModel]:
    """Return a model of the registry.

    Raises:
        UnknownModelError: there is no such model.
    """
    return find(LANE_CHANGE_MODELS, name, "lane-change")


def check_known(classes: Sequence[VehicleClass]) -> None:
    """Refuse vehicle classes whose lane-change model is not in the registry.

    Raises:
        TypeError: there is one; the message lists the known models.
    """
    known = {entry.model: entry.name for entry in LANE_CHANGE_MODELS}
    for vehicle_class in classes:
        if type(vehicle_class.lane_change) not in known:
            got = type(vehicle_class.lane_change).__name__
            raise TypeError(f"Expected a lane-change model of the registry ({', '.join(known.values())}), got {got}.")


_STRATEGIC = Parameter("strategic", 1.0, 0.1, 10.0, is_logarithmic=True)
_ASSERTIVE = Parameter("assertive", 1.0, 0.2, 5.0, traffic=(0.4, 4.0), is_logarithmic=True)
_LOOK_AHEAD_LEFT = Parameter("look_ahead_left", 2.0, 0.5, 10.0, traffic=(0.5, 5.0), is_logarithmic=True)
_LC2013 = (
    _STRATEGIC,
    Parameter("cooperative", 1.0, 0.0, 1.0),
    Parameter("cooperative_speed", 1.0, 0.0, 1.0),
    Parameter("speed_gain", 1.0, 0.05, 10.0, traffic=(0.1, 10.0), is_logarithmic=True, step=0.25),
    Parameter("speed_gain_right", 0.1, 0.01, 1.0, traffic=(0.02, 2.0), is_logarithmic=True),
    Parameter("speed_gain_remain_time_s", 20.0, 0.0, 60.0, traffic=(2.0, 60.0), is_logarithmic=True),
    Parameter("keep_right", 1.0, 0.0, 10.0, traffic=(0.0, 5.0)),
    _ASSERTIVE,
    _LOOK_AHEAD_LEFT,
)

LC2013 = ModelEntry("lc2013", "SUMO's default model", Lc2013, _LC2013, source="documentation of SUMO")
LANE_CHANGE_MODELS: tuple[ModelEntry[LaneChangeModel], ...] = (
    LC2013,
    ModelEntry(
        "mobil", "model of Kesting, Treiber and Helbing", Mobil,
        (Parameter("politeness", 0.2, 0.0, 1.0), Parameter("safe_deceleration_mps2", 4.0, 0.5, 9.0),
         Parameter("changing_threshold_mps2", 0.1, 0.0, 2.0), Parameter("keep_right_bias_mps2", 0.2, 0.0, 2.0),
         Parameter("european_rule", 0.0, 0.0, 1.0), _STRATEGIC, _ASSERTIVE, _LOOK_AHEAD_LEFT),
    ),
    ModelEntry(
        "vissim", "VISSIM's model as its manual describes it", Vissim,
        (Parameter("safety_distance_factor", 0.6, 0.1, 1.0), Parameter("min_clearance_m", 0.5, 0.1, 5.0),
         Parameter("max_deceleration_own_mps2", 4.0, 0.5, 9.0),
         Parameter("max_deceleration_trailing_mps2", 3.0, 0.5, 9.0),
         Parameter("accepted_deceleration_own_mps2", 1.0, 0.1, 3.0),
         Parameter("accepted_deceleration_trailing_mps2", 1.0, 0.1, 3.0),
         Parameter("deceleration_reduction_distance_m", 200.0, 20.0, 500.0),
         Parameter("cooperative_deceleration_mps2", 3.0, 0.5, 9.0),
         Parameter("cooperative_speed_difference_mps", 3.0, 0.0, 10.0),
         Parameter("collision_time_s", 10.0, 1.0, 1000.0), _STRATEGIC, _LOOK_AHEAD_LEFT),
    ),
)  # fmt: skip
