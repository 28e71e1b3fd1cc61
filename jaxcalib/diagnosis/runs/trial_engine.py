"""The surrogate that makes a diagnosis' trials: with all effects of the library, and recording what is perceived."""

import numpy as np

from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.frame_recorder import FrameRecorder
from jaxcalib.diagnosis.runs.trials import TrialRunner
from jaxcalib.problem.engines import DECISION_INTERVAL_S, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.drives_in_turn import interleaved

SPARE_CAPACITY = 1.8  # effects can make traffic denser
PLACES_FOR_OBJECTS = 128
FRAMES_STEP = 128


def trial_runner(
    problem: CalibrationProblem,
    features: DriveFeatures,
    first_seed: int,
    decision_interval_s: float = DECISION_INTERVAL_S,
) -> TrialRunner:
    """The maker of trials of a problem, with decisions as often as the calibration's surrogate made them."""
    longest_s = problem.parts.scenario.duration_s - min(drive.depart_s for drive in problem.case.drives)
    num_frames = FRAMES_STEP * int(np.ceil((longest_s / problem.frame_interval_s + 2) / FRAMES_STEP))
    recorder = FrameRecorder(num_frames, PLACES_FOR_OBJECTS)
    engine = surrogate_engine(
        problem, SPARE_CAPACITY, observer=recorder, decision_interval_s=decision_interval_s
    ).with_effects()
    starts = interleaved(problem.drive_starts())
    return TrialRunner(engine, recorder, features, starts, first_seed, problem.frame_interval_s)
