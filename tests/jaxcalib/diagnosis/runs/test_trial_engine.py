"""The surrogate of the trials is that of the calibration, but for room and observer."""

import re
from pathlib import Path
from typing import Any, cast

import pytest

from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.frame_recorder import FrameRecorder
from jaxcalib.diagnosis.runs.trial_engine import trial_runner
from jaxcalib.problem import engines
from jaxcalib.problem.problem import read_problem
from tests.copies import copy_corridor


@pytest.mark.parametrize("changing_s", [0.0, 2.6])
def test_trials_change_lane_as_slowly_as_the_scenario_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changing_s: float
):
    case = copy_corridor(tmp_path / "corridor", "d01", "d03")
    (configuration,) = (case / "scenario").glob("*.sumocfg")
    option = f'<processing><lanechange.duration value="{changing_s}"/>'
    configuration.write_text(re.sub("<processing>", option, configuration.read_text()))
    problem = read_problem(case)
    made: list[dict[str, Any]] = []

    class Engine:
        def __init__(self, **arguments: Any) -> None:
            made.append(arguments)

        def with_effects(self) -> "Engine":
            return self

    monkeypatch.setattr(engines, "JaxSimulator", Engine)
    engines.surrogate_engine(problem)
    trial_runner(problem, cast(DriveFeatures, None), 0)
    calibration, trials = made
    assert trials["clock"].lane_change_duration_s == changing_s
    assert isinstance(trials["observer"], FrameRecorder)
    assert trials["capacity"] > calibration["capacity"]
    assert type(trials["programs"]) is type(calibration["programs"])
    for name in ("template", "clock", "end_s", "frame_interval_s", "most_overfull_share", "runs_per_device"):
        assert trials[name] == calibration[name]
    assert trials.keys() == calibration.keys()
