"""First seeds of each kind of run. Behind a command's first seed no two kinds share one."""

from jaxcalib.case.case import Role

SEEDS_PER_CALIBRATION = 1_000_000  # of any command: no two values of --seed share a run's seed
MOST_SEED = 2_000  # of --seed: SUMO takes 32 bits

SEARCH_SEED = 0
CONFIRMATION_SEED = 200_000
FINAL_SEEDS: dict[Role, int] = {"held_out": 300_000, "fit": 400_000}
VALIDATION_SEED = 500_000
NULL_SEED = 600_000  # the diagnosis: SUMO with the calibrated values,
DEFAULT_SEED = 700_000  # SUMO with the scenario as it is,
TRIAL_SEED = 800_000  # the surrogate with effects,
CHECK_SEED = 900_000  # SUMO with the effects that may explain the gap,
LOOK_SEED = 925_000  # with each that it has means for,
EXPLAINED_SEED = 950_000  # and with values fitted to an effect

# Behind the seeds of a search: runs that must not have been seen by what they judge.
GENERATION_OFFSET = 1_000  # each generation has its own
SHORTLIST_OFFSET = 20_000  # the few candidates that may win, run longer
NOISE_OFFSET = 50_000  # runs that measure the noise of a point, and the last comparison
