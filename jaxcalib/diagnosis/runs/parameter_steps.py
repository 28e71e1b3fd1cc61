"""By how much each parameter is moved to see what it does to the features."""

import numpy as np

from jaxcalib.problem.parameter_space import slope_share
from sim_adapters.interface import ParameterLayout

# Steps for slopes, as shares of the value: about what a calibration leaves open.
INPUT_STEPS = (0.05, 0.2)  # largest inflow, and others
LEAST_STEP = 0.02
LEAST_LANE_CHANGE_STEP = 0.1  # SUMO's lane-change weights are about 1; a share of one near 0 would be no step at all


def parameter_steps(layout: ParameterLayout, values: np.ndarray) -> np.ndarray:
    """Return the step of each parameter for its slope."""
    largest = int(np.argmax(values[: layout.num_inputs]))
    shares = [INPUT_STEPS[0] if number == largest else INPUT_STEPS[1] for number in range(layout.num_inputs)]
    shares += [slope_share(attribute) for _, attribute in layout.driver_parameters]
    least = [LEAST_LANE_CHANGE_STEP if name.startswith("lc") else LEAST_STEP for name in layout.names]
    return np.maximum(np.abs(values) * np.asarray(shares), least)
