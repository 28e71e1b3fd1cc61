"""Recorded tables that contradict themselves: the line names the cause, whatever else would not fit the road for it."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from experiments.log_faults.faults import FAULTS
from jaxcalib.case.case import Case, read_case
from jaxcalib.field.drive_logs import read_drives
from jaxcalib.field.route_geometry import build_route_geometry
from sim_adapters.scenario.scenario import Scenario
from tests.places import CORRIDOR

Table = pd.DataFrame
NUM_DRIVES = 2


@pytest.fixture(scope="module")
def case() -> Case:
    whole = read_case(CORRIDOR)
    return dataclasses.replace(whole, drives=whole.drives[:NUM_DRIVES])


def read_spoilt(
    case: Case, scenario: Scenario, folder: Path, spoil: Callable[[Table, Table], tuple[Table, Table]]
) -> tuple[list[str], list[str]]:
    """Refusals and warnings where the tables of all drives are spoilt."""
    drives = []
    for drive in case.drives:
        subject, objects = spoil(pd.read_csv(drive.subject_file), pd.read_csv(drive.objects_file))
        files = folder / f"{drive.id}_subject.csv", folder / f"{drive.id}_objects.csv"
        subject.to_csv(files[0], index=False)
        objects.to_csv(files[1], index=False)
        drives.append(dataclasses.replace(drive, subject_file=files[0], objects_file=files[1]))
    logs = read_drives(dataclasses.replace(case, drives=tuple(drives)), scenario.row_map)
    return [str(refusal) for refusal in logs.refusals], list(logs.contradictions)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            FAULTS["all_mps"].spoil,
            ["3.60 times too small for the way that the places show: m/s?", "3.60 times too small: m/s?"],
        ),
        (FAULTS["late_18"].spoil, ["the objects' times are 18.0 s late"]),
        (FAULTS["relative"].spoil, ["are they relative to the subject vehicle's"]),
        (FAULTS["aside"].spoil, ["Places seem to lie 1"]),
    ],
)
def test_the_cause_is_named(
    spoil: Callable[[Table, Table], tuple[Table, Table]],
    words: list[str],
    case: Case,
    corridor: Scenario,
    tmp_path: Path,
):
    refusals, _ = read_spoilt(case, corridor, tmp_path, spoil)
    for expected in words:
        assert any(expected in refusal for refusal in refusals), refusals


def test_lanes_counted_from_the_left_are_told_from_places_that_lie_aside(
    case: Case, corridor: Scenario, tmp_path: Path
):
    geometry = build_route_geometry(corridor.row_map)
    lanes_of = dict(zip(geometry.edges, geometry.num_lanes.tolist(), strict=True))

    def from_left(subject: Table, objects: Table) -> tuple[Table, Table]:
        return subject.assign(lane=subject.road.map(lanes_of).fillna(3) + 1 - subject.lane), objects

    refusals, _ = read_spoilt(case, corridor, tmp_path, from_left)
    assert any("counted from the left" in refusal for refusal in refusals), refusals


def test_good_logs_are_believed(case: Case, corridor: Scenario, tmp_path: Path):
    assert read_spoilt(case, corridor, tmp_path, lambda subject, objects: (subject, objects)) == ([], [])
