"""First seeds of each kind of run; no two kinds share one."""

from jaxcalib.case.case import Role

SEEDS_PER_CALIBRATION = 1_000_000
MOST_SEED = 2_000  # SUMO takes 32 bits
SEARCH_SEED = 0
CONFIRMATION_SEED = 200_000
FINAL_SEEDS: dict[Role, int] = {"held_out": 300_000, "fit": 400_000}
