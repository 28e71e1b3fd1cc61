"""Rows of the parameters that most car-following models share; a model lists those that it has.

Source of the ranges: Kesting & Treiber (2008), Transp. Res. Rec. 2088, widened to what drivers do and SUMO accepts.
"""

from surrogate.vehicle.model_entry import Parameter

JAM_GAP = Parameter("jam_gap_m", 2.0, 0.5, 6.0, is_logarithmic=True)
TIME_GAP = Parameter("time_gap_s", 1.2, 0.3, 3.5, traffic=(0.4, 3.0), is_logarithmic=True, step=0.06)
# SUMO's passenger cars have 2.6 and 4.5 m/s^2: traffic needs room above them
MAX_ACCELERATION = Parameter("max_acceleration_mps2", 1.5, 0.3, 4.0, traffic=(0.3, 5.0), is_logarithmic=True)
MAX_DECELERATION = Parameter("max_deceleration_mps2", 2.0, 0.5, 6.0, traffic=(0.5, 8.0), is_logarithmic=True, step=0.12)
BASIC = (JAM_GAP, TIME_GAP, MAX_ACCELERATION, MAX_DECELERATION)
KESTING_TREIBER = "Kesting & Treiber (2008), Transp. Res. Rec. 2088, widened"

EMERGENCY = {"emergency_deceleration_mps2": 9.0}
# what a model's own rules do not use, but stops and lane changes do
STOPS = {"jam_gap_m": 2.0, "time_gap_s": 1.2, "max_deceleration_mps2": 3.0}
