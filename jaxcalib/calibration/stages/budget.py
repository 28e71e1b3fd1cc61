"""How many runs each part gets, from the size of the scenario alone, so that the same command does the same work."""

from dataclasses import dataclass, replace

from jaxcalib.calibration.stages.screening import SHORTLIST_RUNS, small_array, smallest_array
from jaxcalib.problem.engines import expected_vehicles
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.drives_in_turn import in_rounds

# A run of a corridor, in places for vehicles times steps. Larger scenarios get fewer runs per candidate, but not in
# proportion: what they cost grows with the square root of their size.
SMALL_RUN = 3e6
RUNS_PER_CANDIDATE = 4.0
FEWEST_RUNS = 2
SIZE_EXPONENT = 0.5
LARGE_RATIO = 3.0
FRESH_SEEDS = 12  # for the final errors on held-out drives
MOST_FRESH_SEEDS = 100
NOISE_RUNS, LARGE_NOISE_RUNS = 64, 32  # whole batches of two cores; fewer would leave places in them empty
# Runs behind the covariance of the moments at the point that is searched from: between three and four to a moment.
# With as many runs as moments, candidates come in another order than under the true covariance
# (experiments/results/paper.md).
COVARIANCE_RUNS = 192
GENERATION = 16  # of SAGA; others take their own batches
MOST_POLISHES, MOST_SUMO_POLISHES = 5, 2
MOST_MAPPINGS = 3
SHORTLISTED = 5  # candidates, about
SUMO_NOISE_ROUNDS, SUMO_GENERATIONS = 12, 2  # where SUMO makes the search's runs
QUICK = 0.5  # below it SUMO confirms one finalist only


@dataclass(frozen=True)
class Budget:
    """Numbers of runs."""

    runs_per_candidate: int  # while screening and in the search of the critical parameters
    noise_runs: int  # to estimate the noise of the measures where the search begins, and to compare its results
    covariance_runs: int  # the same where driver behaviour is searched from, for the noise of all moments together
    polish_runs: int  # per candidate of the joint polish
    num_evaluations: int  # candidates of Stage 2's optimiser
    most_polishes: int  # of all parameters, each from where the one before led; see `polish_on`
    confirmation_rounds: int  # alternations of surrogate and SUMO
    confirmation_runs: int  # SUMO runs per finalist and round
    final_runs: int  # SUMO runs of the result, and of the scenario as it was, on held-out drives
    final_fit_runs: int  # the same on the drives to fit
    most_mappings: int  # steps of space mapping, where the surrogate drives unlike SUMO; see `search_mapped`
    num_search_runs: int = 0  # of the search, about, for the progress bar
    is_in_sumo: bool = False  # whether SUMO makes them
    scale: float = 1.0  # what the numbers were made for

    @property
    def num_surrogate_runs(self) -> int:
        """Runs of the surrogate in all, about."""
        return 0 if self.is_in_sumo else self.num_search_runs

    @property
    def num_sumo_runs(self) -> int:
        """SUMO runs in all, about."""
        searching = self.num_search_runs if self.is_in_sumo else 0
        confirming = self.confirmation_rounds * self.confirmation_runs
        return searching + confirming + 2 * (self.final_runs + self.final_fit_runs)


def plan_budget(problem: CalibrationProblem, scale: float = 1.0, *, in_sumo: bool = False) -> Budget:
    """Return the numbers of runs for a problem.

    Args:
        problem: the problem.
        scale: 1 for the default; numbers of runs grow and shrink with it.
        in_sumo: whether SUMO makes the search's runs, too; see `in_sumo_alone`.
    """
    plan = _plan_budget(problem, scale)
    return in_sumo_alone(plan, problem, scale) if in_sumo else plan


def in_sumo_alone(plan: Budget, problem: CalibrationProblem, scale: float) -> Budget:
    """The numbers of runs where SUMO makes them all: a tenth of the surrogate's, each candidate on each drive once.

    Drives share runs where they depart far enough apart, so that a candidate costs one run or few.
    """
    num_fit = len(problem.drive_starts("fit"))
    rounds = max(1, round(scale))
    noise_rounds = max(6, round(SUMO_NOISE_ROUNDS * min(scale, 2.0)))
    num_evaluations = max(2, round(SUMO_GENERATIONS * min(scale, 3.0))) * GENERATION
    plan = replace(
        plan,
        runs_per_candidate=rounds * num_fit,
        noise_runs=noise_rounds * num_fit,
        covariance_runs=2 * noise_rounds * num_fit,
        polish_runs=rounds * num_fit,
        num_evaluations=num_evaluations,
        most_polishes=min(plan.most_polishes, MOST_SUMO_POLISHES),
        confirmation_rounds=1,
        is_in_sumo=True,
    )
    return replace(plan, num_search_runs=_num_search_runs(problem, plan))


def with_mapping(plan: Budget, problem: CalibrationProblem) -> Budget:
    """The numbers of runs of a search that goes on by space mapping, as the progress bar counts them.

    Each of its steps polishes twice in the surrogate, where about half of the runs are known already, and has two
    finalists.
    """
    return replace(
        plan,
        num_search_runs=plan.num_search_runs + plan.most_mappings * runs_of_polish(plan, problem),
        confirmation_rounds=plan.confirmation_rounds + 2 * plan.most_mappings,
    )


def runs_of_polish(plan: Budget, problem: CalibrationProblem) -> int:
    """Return the runs of a polish of all parameters, about."""
    return (len(problem.layout.names) + 6) * in_rounds(problem.drive_starts("fit"), plan.polish_runs)


def _plan_budget(problem: CalibrationProblem, scale: float) -> Budget:
    scenario = problem.parts.scenario
    size = expected_vehicles(problem) * scenario.duration_s / scenario.step_s
    ratio = max(1.0, size / SMALL_RUN)
    is_large = ratio > LARGE_RATIO
    per_candidate = max(FEWEST_RUNS, round(RUNS_PER_CANDIDATE * scale / ratio**SIZE_EXPONENT))
    noise_runs = round((LARGE_NOISE_RUNS if is_large else NOISE_RUNS) * min(max(scale, 0.5), 4.0))
    covariance_runs = max(noise_runs, round(COVARIANCE_RUNS * min(scale / QUICK, 1.0)))
    polish_runs = (2 if is_large else 3) * per_candidate
    num_fit, num_held_out = len(problem.drive_starts("fit")), len(problem.drive_starts("held_out"))

    num_seeds = min(FRESH_SEEDS * scale, MOST_FRESH_SEEDS)
    final_runs = num_held_out * max(2, round(num_seeds / max(num_held_out, 1)))

    num_evaluations = GENERATION * max(2, round((4 if is_large else 5) * min(scale, 3.0)))
    plan = Budget(
        runs_per_candidate=per_candidate,
        noise_runs=noise_runs,
        covariance_runs=covariance_runs,
        polish_runs=polish_runs,
        num_evaluations=num_evaluations,
        most_polishes=MOST_POLISHES if scale >= QUICK else 1,
        confirmation_rounds=2 if scale >= QUICK else 1,
        confirmation_runs=num_fit if is_large or scale < QUICK else round(1.5 * num_fit),
        final_runs=final_runs,
        final_fit_runs=num_fit,
        most_mappings=MOST_MAPPINGS if scale >= QUICK else 1,
        scale=scale,
    )
    return replace(plan, num_search_runs=_num_search_runs(problem, plan))


def _num_search_runs(problem: CalibrationProblem, plan: Budget) -> int:
    """Return the runs that a search makes, about."""
    starts, layout = problem.drive_starts("fit"), problem.layout
    cases = small_array(layout.num_inputs).num_cases + smallest_array(len(layout.names)).num_cases
    per_candidate = in_rounds(starts, plan.runs_per_candidate)
    return (
        (cases + plan.num_evaluations + 3 * SHORTLISTED * SHORTLIST_RUNS) * per_candidate
        + 2 * runs_of_polish(plan, problem)
        + 8 * in_rounds(starts, plan.noise_runs)
        + in_rounds(starts, plan.covariance_runs)
    )
