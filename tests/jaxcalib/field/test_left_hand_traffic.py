"""A road and a log that are mirrored are the same drive: left-hand traffic is mirrored once, where logs are read."""

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxcalib.case.case import Case, read_case
from jaxcalib.field.field_log import DriveLog, read_drive
from jaxcalib.field.route_geometry import build_route_geometry
from sim_adapters.scenario.scenario import Scenario, read_scenario
from tests.places import CORRIDOR

SHAPE = re.compile(r'(hape=")([^"]*)"')


def mirrored_network(text: str) -> str:
    """Mirror what is drawn: y of all lanes; vehicles drive on the other side."""

    def turn(match: re.Match) -> str:
        points = (point.split(",") for point in match.group(2).split())
        return match.group(1) + " ".join(f"{x},{-float(y)}" for x, y, *_ in points) + '"'

    return SHAPE.sub(turn, text).replace("<net ", '<net lefthand="true" ', 1)


@pytest.fixture(scope="module")
def mirrored(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    folder = tmp_path_factory.mktemp("mirrored") / "scenario"
    shutil.copytree(CORRIDOR / "scenario", folder)
    file = folder / "net.net.xml"
    file.write_text(mirrored_network(file.read_text()))
    return read_scenario(folder / "scenario.sumocfg", "ego", 720.0)


def tables(corridor: Scenario, *, has_object_lanes: bool) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return a drive's tables with places in the network's plane."""
    subject = pd.read_csv(CORRIDOR / "field/d01_subject.csv.gz")
    objects = pd.read_csv(CORRIDOR / "field/d01_objects.csv.gz")
    geometry = build_route_geometry(corridor.row_map)
    degrees = (np.degrees(subject[f"{name}_rad"]) for name in ("longitude", "latitude"))
    x, y = geometry.projection(*map(np.asarray, degrees))
    subject["x_m"], subject["y_m"] = x + geometry.net_offset_m[0], y + geometry.net_offset_m[1]
    if not has_object_lanes:
        objects["lane"] = np.nan
    return subject.drop(columns=["longitude_rad", "latitude_rad"]), objects


def read(case: Case, scenario: Scenario, folder: Path, subject: pd.DataFrame, objects: pd.DataFrame) -> DriveLog:
    folder.mkdir()
    files = folder / "d01_subject.csv", folder / "d01_objects.csv"
    for file, table in zip(files, (subject, objects), strict=True):
        table.to_csv(file, index=False)
    drive = dataclasses.replace(case.drives[0], subject_file=files[0], objects_file=files[1])
    return read_drive(case, drive, scenario.row_map)


@pytest.mark.parametrize("has_object_lanes", [True, False])
def test_a_mirrored_drive_is_the_same_drive(
    corridor: Scenario, mirrored: Scenario, tmp_path: Path, has_object_lanes: bool
):
    assert (corridor.network.is_left_hand, mirrored.network.is_left_hand) == (False, True)
    assert "mirrored" in mirrored.findings[0].words
    case, num_lanes = read_case(CORRIDOR), corridor.network.lane_count
    subject, objects = tables(corridor, has_object_lanes=has_object_lanes)
    # lanes are counted on the edge of each vehicle: that of the subject vehicle stands in its log
    roads = subject.set_index("time_s")["road"]
    if has_object_lanes:  # who is farther off may be on another edge, with other numbers
        objects = objects[objects["relative_x_m"].abs() < 1.0]
    as_it_was = read(case, corridor, tmp_path / "right", subject, objects)
    subject["y_m"] *= -1.0
    subject["lane"] = [num_lanes[road] + 1 - lane for road, lane in zip(subject["road"], subject["lane"], strict=True)]
    lanes = [num_lanes[roads[time]] + 1 - lane for time, lane in zip(objects["time_s"], objects["lane"], strict=True)]
    objects = objects.assign(relative_y_m=-objects["relative_y_m"], lane=lanes)
    turned = read(case, mirrored, tmp_path / "left", subject, objects)
    assert len(as_it_was.objects.row) > 10
    for one, other in ((as_it_was.subject, turned.subject), (as_it_was.objects, turned.objects)):
        for field in dataclasses.fields(one):
            np.testing.assert_allclose(
                getattr(other, field.name), getattr(one, field.name), atol=1e-6, err_msg=field.name
            )
    np.testing.assert_array_equal(turned.subject.row, as_it_was.subject.row)
    np.testing.assert_array_equal(turned.objects.row, as_it_was.objects.row)
