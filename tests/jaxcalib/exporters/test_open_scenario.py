"""ASAM OpenSCENARIO XML: valid by the standard's schema, and what is read back is the traffic that SUMO had."""

import sys
import xml.etree.ElementTree as ET
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumolib

pytest.importorskip("scenariogeneration", reason="the extra 'openscenario' is not installed")

from lxml import etree
from scenariogeneration import xosc
from scipy.spatial import KDTree

from jaxcalib.cli.app import app
from jaxcalib.errors import CaseError
from jaxcalib.exporters.export import export
from jaxcalib.exporters.open_scenario import NO_ROAD, export_open_scenario, write_open_scenario
from jaxcalib.exporters.recorded_run import RecordedRun
from jaxcalib.exporters.tracks import read_tracks
from jaxcalib.importers.sumo_fcd import slices_in
from jaxcalib.importers.trajectories import Slice
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.sumo.trajectories import record_trajectories
from tests.jaxcalib.exporters.traffic import KINDS, run_of_the_scenario, slice_at
from tests.places import CORRIDOR
from tests.sim_adapters.sumo.open_drive_lanes import SAMPLE_M, lane_middles_m

STEP_S, YAW_RAD = 0.1, 0.4
WRITTEN_M = 2e-4  # places are written, and read from SUMO, with four digits
REAR_AXLE_SHARE = 0.8  # of the length, behind the front bumper


def slices() -> list[Slice]:
    """The subject vehicle drives and then stands; a lorry joins it; a motorcycle with the name of its role leaves."""
    made = []
    for number in range(40):
        along_m = 20.0 * STEP_S * min(number, 30)
        x_m, y_m = 1000.0 + np.cos(YAW_RAD) * along_m, 500.0 + np.sin(YAW_RAD) * along_m
        vehicles = {"ego": (x_m, y_m, YAW_RAD, 20.0 if number <= 30 else 0.0)}
        if number >= 5:
            vehicles["lorry.7"] = (1040.0, 504.0 + number, np.radians(90.0), 10.0)
        if number < 25:
            vehicles["Ego"] = (990.0 - number, 500.0, np.radians(-180.0), 10.0)
        made.append(slice_at(300.0 + STEP_S * number, vehicles))
    return made


def written(file: Path, **options: Any) -> xosc.Scenario:
    """The scenario as its own package reads it, after the schema has had its say."""
    tracks = read_tracks(slices(), "ego")
    assert write_open_scenario(file, tracks, KINDS, "ego", road="road.xodr", title="two", **options) == 3
    return read_valid(file)


def read_valid(file: Path) -> xosc.Scenario:
    """The scenario, of a file that is valid."""
    shipped = [one for one in files("scenariogeneration") or [] if one.name == "OpenSCENARIO_1_2.xsd"]
    assert shipped, "scenariogeneration ships no schema any more"
    schema = etree.XMLSchema(etree.parse(str(shipped[0].locate())))
    schema.assertValid(etree.parse(str(file)))
    return xosc.Scenario.parse(ET.parse(file).getroot())


def events_of(scenario: xosc.Scenario) -> dict[str, list[Any]]:
    """Events of each vehicle."""
    (story,) = scenario.storyboard.stories
    (act,) = story.acts
    return {group.name: [event for one in group.maneuvers for event in one.events] for group in act.maneuvergroup}


def actions_of(event: Any) -> list[Any]:
    """Actions of an event."""
    return [one.action for one in event.action]


def time_of(event: Any) -> float:
    """When an event happens."""
    trigger = event.trigger
    condition = trigger.conditiongroups[0].conditions[0] if hasattr(trigger, "conditiongroups") else trigger
    return condition.valuecondition.value


def test_vehicles_are_what_they_are_around_the_middle_of_the_rear_axle(tmp_path: Path):
    objects = {one.name: one.entityobject for one in written(tmp_path / "a.xosc").entities.scenario_objects}
    assert list(objects) == ["Ego", "Ego_of_SUMO", "lorry.7"]
    ego, lorry = objects["Ego"], objects["lorry.7"]
    assert (ego.vehicle_type.get_name(), lorry.vehicle_type.get_name()) == ("car", "truck")
    assert objects["Ego_of_SUMO"].vehicle_type.get_name() == "motorbike"
    box = lorry.boundingbox
    assert (box.boundingbox.length, box.boundingbox.width, box.boundingbox.height) == (14.0, 2.5, 3.6)
    front_m = box.center.x + 0.5 * box.boundingbox.length
    assert front_m == pytest.approx(REAR_AXLE_SHARE * 14.0)
    assert 0.0 < lorry.axles.frontaxle.xpos < front_m
    assert lorry.axles.rearaxle.xpos == 0.0


def test_every_trajectory_is_where_sumo_had_the_vehicle_at_the_time(tmp_path: Path):
    events = events_of(written(tmp_path / "a.xosc"))
    assert list(events) == ["Ego", "Ego_of_SUMO", "lorry.7"]
    (follow,) = actions_of(events["Ego"][0])
    assert (follow.following_mode.get_name(), follow.timeref.reference_domain.get_name()) == ("position", "absolute")
    assert (follow.timeref.scale, follow.timeref.offset) in ((1.0, 0.0), ("1.0", "0.0"))
    line = follow.trajectory.shapes
    assert line.time == pytest.approx([STEP_S * number for number in range(40)], abs=1e-9)
    front = [
        (p.x + REAR_AXLE_SHARE * 4.8 * np.cos(p.h), p.y + REAR_AXLE_SHARE * 4.8 * np.sin(p.h)) for p in line.positions
    ]
    expected = [(one.x_m[0], one.y_m[0]) for one in slices()]
    np.testing.assert_allclose(front, expected, atol=WRITTEN_M)
    assert line.positions[0].h == pytest.approx(YAW_RAD, abs=1e-6)
    assert line.positions[0].z is None  # players put it onto the road


def test_who_enters_later_is_added_and_who_leaves_is_deleted_at_its_time(tmp_path: Path):
    scenario = written(tmp_path / "a.xosc")
    assert list(scenario.storyboard.init.initactions) == ["Ego", "Ego_of_SUMO"]
    events = events_of(scenario)
    (lorry,) = events["lorry.7"]
    add, follow = actions_of(lorry)
    assert isinstance(add, xosc.AddEntityAction)
    assert add.position == follow.trajectory.shapes.positions[0]
    assert time_of(lorry) == follow.trajectory.shapes.time[0] == 0.5
    assert (add.position.x, add.position.y) == pytest.approx((1040.0, 509.0 - REAR_AXLE_SHARE * 14.0), abs=WRITTEN_M)
    drives, leaves = events["Ego_of_SUMO"]
    assert isinstance(actions_of(leaves)[0], xosc.DeleteEntityAction)
    assert (time_of(drives), time_of(leaves)) == (0.0, 2.4)
    assert len(events["Ego"]) == 1
    assert scenario.roadnetwork.road_file == "road.xodr"


def test_a_free_subject_vehicle_has_place_and_speed_and_no_trajectory(tmp_path: Path):
    scenario = written(tmp_path / "a.xosc", has_free_subject=True)
    assert list(events_of(scenario)) == ["Ego_of_SUMO", "lorry.7"]
    place, speed = scenario.storyboard.init.initactions["Ego"]
    x_m = 1000.0 - REAR_AXLE_SHARE * 4.8 * np.cos(YAW_RAD)
    assert (place.position.x, speed.speed) == (pytest.approx(x_m, abs=WRITTEN_M), 20.0)


def test_a_free_subject_vehicle_alone_is_a_valid_scenario(tmp_path: Path):
    file = tmp_path / "a.xosc"
    tracks = read_tracks(slices(), "ego")[:1]
    write_open_scenario(file, tracks, KINDS, "ego", road=None, title="alone", has_free_subject=True)
    assert events_of(read_valid(file)) == {"nobody": []}


@pytest.mark.parametrize("option", [{"range_m": 100.0}, {"free_subject": True}])
def test_options_of_this_format_are_refused_for_others(tmp_path: Path, option: dict[str, Any]):
    with pytest.raises(CaseError, match="expected with --to openscenario alone, got --to fcd"):
        export(CORRIDOR, tmp_path / "run", tmp_path / "out", to="fcd", **option)


def test_without_its_package_the_format_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for module in ("open_scenario", "open_scenario_vehicle"):
        monkeypatch.delitem(sys.modules, f"jaxcalib.exporters.{module}", raising=False)
    monkeypatch.setitem(sys.modules, "scenariogeneration", None)
    with pytest.raises(CaseError, match=r"scenariogeneration, which .* pip install 'jaxcalib\[openscenario\]'"):
        export(CORRIDOR, tmp_path / "run", tmp_path / "out", to="openscenario")


def recorded(folder: Path, problem: CalibrationProblem) -> RecordedRun:
    """Three seconds of the corridor."""
    fcd = folder / "three_seconds.xml.gz"
    values = problem.template.base_values().tolist()
    kinds = record_trajectories(problem.scenario, problem.layout, values, 300.0, "ego", 303.0, 3, fcd, 300.0)
    return RecordedRun(problem, fcd, kinds, folder, "corridor_d01_3")


@pytest.mark.long
def test_a_run_of_sumo_comes_back_and_lies_on_the_road(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, problem: CalibrationProblem
):
    pytest.importorskip("sumo", reason="netconvert is not installed")
    run = recorded(tmp_path, problem)
    scenario, road = export_open_scenario(run, range_m=None, has_free_subject=False)
    assert "'ego' is 'Ego'" in scenario
    assert road == f"{tmp_path / 'corridor_d01_3.xodr'}: the road, ASAM OpenDRIVE."
    tree = KDTree(lane_middles_m(tmp_path / "corridor_d01_3.xodr"))
    expected = {(one.time_s, name): place for one in slices_in(run.fcd)() for name, *place in _places(one)}
    events = events_of(read_valid(tmp_path / "corridor_d01_3.xosc"))
    found = {}
    for vehicle, (drives, *_) in events.items():
        name = "ego" if vehicle == "Ego" else vehicle
        line, behind_m = actions_of(drives)[-1].trajectory.shapes, REAR_AXLE_SHARE * run.vehicles[name].length_m
        for time_s, place in zip(line.time, line.positions, strict=True):
            front = (place.x + behind_m * np.cos(place.h), place.y + behind_m * np.sin(place.h))
            found[(round(300.0 + time_s, 3), name)] = (*front, np.cos(place.h), np.sin(place.h))
    assert len(found) > 1000
    assert len(expected) - len(found) < 10  # who is there for one instant alone
    there = np.asarray(list(found.values()))
    np.testing.assert_allclose(there, [expected[key] for key in found], atol=WRITTEN_M)
    assert tree.query(there[:, :2])[0].max() < 0.5 * SAMPLE_M + 0.2  # lanes do not change their place on the way

    monkeypatch.setattr(sumolib, "checkBinary", lambda name: f"{tmp_path}/{name}")
    said = export_open_scenario(run, range_m=100.0, has_free_subject=True)
    assert said[1] == NO_ROAD
    scenario = read_valid(tmp_path / "corridor_d01_3.xosc")
    assert scenario.roadnetwork.road_file is None
    assert 1 < len(scenario.entities.scenario_objects) < len(events)


@pytest.mark.nightly("a run of SUMO over the whole corridor takes half a minute; commits make one of three seconds")
def test_the_command_writes_a_drive_and_its_road(tmp_path: Path, problem: CalibrationProblem):
    pytest.importorskip("sumo", reason="netconvert is not installed")
    run, out = run_of_the_scenario(tmp_path / "run", problem), tmp_path / "out"
    command = [
        "export",
        str(CORRIDOR),
        str(run),
        "--out",
        str(out),
        "--drive",
        "d01",
        "--seed",
        "5",
        "--range-m",
        "150",
    ]
    assert app([*command, "--to", "openscenario"], result_action="return_value") == 0
    assert sorted(file.name for file in out.iterdir()) == ["corridor_d01_5.xodr", "corridor_d01_5.xosc"]
    scenario = read_valid(out / "corridor_d01_5.xosc")
    assert scenario.roadnetwork.road_file == "corridor_d01_5.xodr"
    events = events_of(scenario)
    (ego,) = events["Ego"]  # it is there to the end
    ends = scenario.storyboard.stoptrigger.conditiongroups[0].conditions[0].valuecondition.value
    assert actions_of(ego)[0].trajectory.shapes.time[-1] == ends > 50.0
    assert any(
        isinstance(one, xosc.DeleteEntityAction) for own in events.values() for e in own for one in actions_of(e)
    )


def _places(one: Slice) -> list[tuple[Any, ...]]:
    """Vehicle, place and direction."""
    return list(
        zip(one.vehicle.tolist(), one.x_m, one.y_m, np.cos(one.heading_rad), np.sin(one.heading_rad), strict=True)
    )
