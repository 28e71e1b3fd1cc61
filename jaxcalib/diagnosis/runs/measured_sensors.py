"""What the sensors' effects are as strong as, where the drives say so by themselves."""

from jaxcalib.field.seen_range import seen_perception
from jaxcalib.problem.problem import CalibrationProblem, drives_to_fit
from surrogate.effects.gap_sensor_bias import GAP_SENSOR_BIAS
from surrogate.effects.sensor_latency import SENSOR_LATENCY
from surrogate.effects.sensor_noise import SENSOR_NOISE
from surrogate.effects.sensor_range import SENSOR_RANGE


def measured_strengths(problem: CalibrationProblem, interval_s: float) -> dict[str, float]:
    """Return the strength of each sensor's effect that drives show without any model of traffic.

    Args:
        problem: the problem, with the range as stated and drives as they are.
        interval_s: of the frames, in whole numbers of which objects are late.
    """
    errors, stated = problem.sensor_errors, problem.case.perception
    seen = seen_perception(drives_to_fit(problem.drives), stated)
    late_s = interval_s * round(errors.late_s / interval_s)
    found = {}
    if errors.distance_factor != 1.0:
        found[GAP_SENSOR_BIAS.name] = errors.distance_factor - 1.0
    if late_s > 0.0:
        found[SENSOR_LATENCY.name] = late_s
    if errors.noise > 0.0:
        found[SENSOR_NOISE.name] = errors.noise
    if 0.0 < seen.ahead_m < stated.ahead_m:
        found[SENSOR_RANGE.name] = 1.0 - seen.ahead_m / stated.ahead_m
    return {name: round(strength, 4) for name, strength in found.items()}
