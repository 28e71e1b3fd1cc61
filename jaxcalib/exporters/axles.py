"""Where the axles of SUMO's vehicles lie, which know lengths, widths and heights alone.

The wheelbase is WHEELBASE_SHARE of the length, with as much ahead of it as behind, as cars have it.
"""

from sim_adapters.sumo.trajectories import VehicleKind

WHEELBASE_SHARE = 0.6  # of the length
WHEEL_M = 0.65  # diameter of wheels, of a car's size


def wheelbase_m(kind: VehicleKind) -> float:
    """From the rear to the front axle."""
    return WHEELBASE_SHARE * kind.length_m


def rear_overhang_m(kind: VehicleKind) -> float:
    """From the rear axle to the rear end."""
    return 0.5 * (kind.length_m - wheelbase_m(kind))
