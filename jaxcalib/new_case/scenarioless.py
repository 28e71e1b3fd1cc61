"""case.toml of logs whose road nobody has made a scenario of yet."""

from pathlib import Path

from jaxcalib.new_case.case_text import Line, NewDrive, Table
from jaxcalib.new_case.guesses import USUAL_RANGE_M, range_m
from jaxcalib.new_case.new_case import NewLogs
from jaxcalib.new_case.subject_vehicle import path_from

USUAL_LENGTH_M = 4.8


def tables_without_scenario(logs: NewLogs, folder: Path) -> list[Table]:
    """The sections that such a case has."""
    ahead_m, behind_m = (range_m([getattr(drive, side) for drive in logs.drives]) for side in ("ahead_m", "behind_m"))
    perception = (
        Line("ahead_m", ahead_m or USUAL_RANGE_M, "guess: farthest object of the logs, rounded up"),
        Line("behind_m", behind_m or USUAL_RANGE_M, "" if behind_m else "guess: the logs have no object there"),
        Line("reference", "front"),
        Line("nominal_length_m", USUAL_LENGTH_M, "guess"),
    )
    drives = [
        NewDrive(
            drive.id,
            drive.begin_s,
            path_from(folder, drive.subject_file),
            path_from(folder, drive.objects_file),
            role,
        ).table("the log's first row")
        for drive, role in zip(logs.drives, logs.all_roles, strict=True)
    ]
    return [Table("[perception]", perception), *drives]
