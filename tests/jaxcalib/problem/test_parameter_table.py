"""The one table of parameters: its rows say what the models have."""

import dataclasses

import pytest

from jaxcalib.problem.parameter_space import default_parameters, ranges_of, slope_share
from sim_adapters.scenario.sumo_names import SUMO_MODELS, attribute_values, attributes_of, parameter_of
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS
from surrogate.lane_change.registry import LANE_CHANGE_MODELS
from surrogate.vehicle.model_entry import ModelEntry
from surrogate.vehicle.vehicle_class import DESIRED_SPEED

ENTRIES = (*CAR_FOLLOWING_MODELS, *LANE_CHANGE_MODELS)
every_entry = pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
every_sumo_model = pytest.mark.parametrize("model", SUMO_MODELS)


@every_entry
def test_rows_and_fixed_values_are_the_fields_of_the_model_each_once(entry: ModelEntry) -> None:
    names = [*(row.name for row in entry.rows), *entry.fixed]
    assert sorted(names) == sorted(field.name for field in dataclasses.fields(entry.model))


@pytest.mark.parametrize("row", [*(row for entry in ENTRIES for row in entry.rows), *DESIRED_SPEED], ids=str)
def test_ranges_are_ranges_and_hold_the_usual_value(row) -> None:
    assert row.lower <= row.usual <= row.upper
    assert row.lower < row.upper
    assert row.traffic_range[0] < row.traffic_range[1]
    assert row.traffic_range[0] > 0.0 or not row.is_logarithmic
    assert 0.0 < row.step < 1.0


@every_sumo_model
@pytest.mark.parametrize("vehicle_class", ["passenger", "truck", "trailer"])
def test_sumo_s_defaults_lie_within_the_bounds_of_a_search(model: str, vehicle_class: str) -> None:
    values = attribute_values({"vClass": vehicle_class}, model)
    for name, one in ranges_of(model).items():
        assert one.lower <= values[name] <= one.upper, name


@every_sumo_model
def test_what_is_calibrated_by_default_has_bounds(model: str) -> None:
    assert set(default_parameters(model)) <= set(ranges_of(model))


@every_sumo_model
def test_models_that_share_an_attribute_agree_on_its_step(model: str) -> None:
    for name, attribute in attributes_of(model).items():
        row = parameter_of(model, attribute)
        if row is not None:
            assert slope_share(name) == row.step, name


def test_units_are_those_that_names_end_with() -> None:
    idm, w99 = ranges_of("IDM"), ranges_of("W99")
    assert {name: idm[name].unit for name in ("tau", "minGap", "accel", "delta", "lcSpeedGainRemainTime")} == {
        "tau": "s", "minGap": "m", "accel": "m/s2", "delta": "", "lcSpeedGainRemainTime": "s",
    }  # fmt: skip
    assert (w99["cc4"].unit, w99["cc6"].unit) == ("m/s", "1e-4/(m s)")
