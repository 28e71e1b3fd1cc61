"""The surrogate that makes a diagnosis' trials: with all effects of the library, and recording what is perceived."""

import jax.numpy as jnp
import numpy as np

from jaxcalib.diagnosis.features.drive_features import COARSE_S, DriveFeatures
from jaxcalib.diagnosis.features.frame_recorder import FrameRecorder
from jaxcalib.diagnosis.runs.trials import TrialRunner
from jaxcalib.problem.engines import DECISION_INTERVAL_S, OBJECTS_PER_ROW, expected_vehicles
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.jax.simulator import JaxSimulator
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor

SPARE_CAPACITY = 1.8  # effects can make traffic denser
PLACES_FOR_OBJECTS = 128
FRAMES_STEP = 128


def trial_runner(problem: CalibrationProblem, features: DriveFeatures, first_seed: int) -> TrialRunner:
    """Return what makes trials of a problem.

    Args:
        problem: the problem.
        features: what is counted in each run.
        first_seed: seed of each trial's first run.
    """
    scenario, perception = problem.parts.scenario, problem.case.perception
    longest_s = scenario.duration_s - min(drive.depart_s for drive in problem.case.drives)
    num_frames = FRAMES_STEP * int(np.ceil((longest_s / COARSE_S + 2) / FRAMES_STEP))
    recorder = FrameRecorder(num_frames, PLACES_FOR_OBJECTS)
    engine = JaxSimulator(
        template=problem.template,
        observer=recorder,
        sensor=Sensor(
            jnp.asarray(perception.ahead_m, jnp.float32), jnp.asarray(perception.behind_m, jnp.float32), OBJECTS_PER_ROW
        ),
        clock=Clock(scenario.step_s, max(1, round(DECISION_INTERVAL_S / scenario.step_s))),
        end_s=scenario.duration_s,
        capacity=expected_vehicles(problem, SPARE_CAPACITY),
        frame_interval_s=COARSE_S,
    ).with_effects()
    departs = sorted({drive.depart_s for drive in problem.case.drives})
    return TrialRunner(engine, recorder, features, departs, first_seed, COARSE_S)
