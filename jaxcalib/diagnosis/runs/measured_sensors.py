"""What the sensors' effects are as strong as, where the drives say so by themselves."""

from jaxcalib.problem.problem import CalibrationProblem
from surrogate.effects.gap_sensor_bias import GAP_SENSOR_BIAS
from surrogate.effects.sensor_latency import SENSOR_LATENCY
from surrogate.effects.sensor_noise import SENSOR_NOISE
from surrogate.effects.sensor_range import SENSOR_RANGE


def measured_strengths(stated: CalibrationProblem, searched: CalibrationProblem, interval_s: float) -> dict[str, float]:
    """Return the strength of each sensor's effect that drives show without any model of traffic.

    Args:
        stated: the problem with drives as they are.
        searched: the same with the range that was seen.
        interval_s: of the frames, in whole numbers of which objects are late.
    """
    errors, range_of = stated.sensor_errors, stated.case.perception
    late_s = interval_s * round(errors.late_s / interval_s)
    found = {}
    if errors.distance_factor != 1.0:
        found[GAP_SENSOR_BIAS.name] = errors.distance_factor - 1.0
    if late_s > 0.0:
        found[SENSOR_LATENCY.name] = late_s
    if errors.noise > 0.0:
        found[SENSOR_NOISE.name] = errors.noise
    share = errors.most_factor * searched.case.perception.ahead_m / range_of.ahead_m if range_of.ahead_m > 0.0 else 1.0
    if share < 1.0:
        found[SENSOR_RANGE.name] = 1.0 - share
    return {name: round(strength, 4) for name, strength in found.items()}
