"""Does the range pick the right parameters? Range analysis beside Morris and Sobol indices, on the same objective.

Which parameters matter depends on where one looks, so all three look at the same box: the one that Stage 2 explores,
around the initial point. Morris and Sobol indices are SALib's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from SALib.analyze import morris as morris_analysis
from SALib.analyze import sobol as sobol_analysis
from SALib.sample import morris as morris_design
from SALib.sample import sobol as sobol_design
from scipy.stats import rankdata

from experiments.paper.similarity import chance_similarity, similarity_index
from jaxcalib.calibration.objective.evidence import evidence_of
from jaxcalib.calibration.objective.objective_choice import choose_objective
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.screening import smallest_array
from jaxcalib.calibration.stages.search_box import half_width_of, search_box
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.html.drawing import AFTER, svg_grid
from jaxcalib.initial_values.initial_point import find_initial_point
from jaxcalib.problem.engines import prepare_devices, surrogate_engine
from jaxcalib.problem.problem import read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSurrogate
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.runs.run_folder import identify, open_run_folder
from jaxcalib.runs.seeds import NOISE_OFFSET, SEEDS_PER_CALIBRATION
from jaxcalib.search import analyse_ranges

MORRIS_LEVELS = 4
NOISE_RUNS = 64
INDICES = ("range", "morris_mu_star", "sobol_total")
STAGE = "influence"


@dataclass(frozen=True)
class InfluencePlan:
    """What is to be done; see `python -m experiments.paper influence --help`."""

    case: Path
    out: Path
    trajectories: int
    base_samples: int
    runs_per_candidate: int
    seed: int
    settings: Settings
    cores: int


def run_influence(plan: InfluencePlan) -> str:
    """Make all runs that are not in the folder yet, write influence.csv, .json and .svg, and return a summary.

    Raises:
        CaseError: the case, the options or the folder are wrong.
        AllRunsFailedError: the simulator failed.
    """
    prepare_devices(plan.cores)
    problem = read_problem(plan.case)
    options = {"study": "influence", "seed": plan.seed, "settings": repr(plan.settings)}
    with open_run_folder(plan.out, identify(problem.case, options), resume=True) as folder:
        initial = find_initial_point(problem, plan.settings.scaling_factor, plan.settings.bounds, plan.seed)
        engine = JournaledSurrogate(surrogate_engine(problem), folder.journal)
        evaluator = Evaluator(engine, problem.drive_starts("fit"), plan.seed * SEEDS_PER_CALIBRATION)
        space, start = initial.space, initial.space.unit_of(initial.values)
        drivers = range(problem.layout.num_inputs, len(space.names))
        box = search_box(start, drivers, half_width_of(initial.unit_error))
        noise = evaluator.evaluate(space.values_of(start[None]), evaluator.rounds_of(NOISE_RUNS), NOISE_OFFSET)
        runs = noise.tally[0]
        objective = choose_objective(problem, plan.settings, evidence_of(initial), runs[np.isfinite(runs).all(axis=1)])
        run = SearchRun(evaluator, space, objective)
        num_runs = evaluator.rounds_of(plan.runs_per_candidate)

        def accuracy_of(points: np.ndarray) -> np.ndarray:
            return run.judge(box.unit_of(points), num_runs, STAGE).accuracy

        names = [space.names[number] for number in box.chosen]
        num_critical = min(plan.settings.num_critical, len(names))
        table, cost = influence_table(accuracy_of, names, plan.trajectories, plan.base_samples, plan.seed, num_critical)
        folder.write_text("influence.csv", table.to_csv(index=False))
        about = {
            "case": problem.case.name,
            "plan": {"trajectories": plan.trajectories, "base_samples": plan.base_samples,
                     "runs_per_candidate": num_runs, "seed": plan.seed},
            "settings": msgspec.to_builtins(plan.settings),
            "candidates": cost,
            "agreement": agreement(table, num_critical),
            "versions": versions("SALib"),
            "commit": commit(),
        }  # fmt: skip
        folder.write_text("influence.json", msgspec.json.format(msgspec.json.encode(about), indent=1).decode() + "\n")
        folder.write_text("influence.svg", influence_figure(table))
    lines = [table.to_string(index=False), ""]
    lines += [f"{key}: {value}" for key, value in about["agreement"].items()]
    return "\n".join([*lines, f"figure: {plan.out / 'influence.svg'}"])


def influence_table(
    accuracy_of: Callable[[np.ndarray], np.ndarray],
    names: list[str],
    trajectories: int,
    base_samples: int,
    seed: int,
    num_critical: int,
) -> tuple[pd.DataFrame, dict[str, int]]:
    """Return the three indices of each parameter, and how many candidates each of them took.

    Accuracies are those of points of the unit cube, [candidate, parameter]. Saltelli's design takes a power of 2 as the
    number of its base samples. A failed candidate counts like the worst that succeeded: SALib cannot do without it.
    """
    array = smallest_array(len(names))
    cases = accuracy_of(array.levels / (array.num_levels - 1))
    ranges = analyse_ranges(array, cases, num_critical, is_ok=np.isfinite(cases))
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    points = morris_design.sample(problem, trajectories, num_levels=MORRIS_LEVELS, seed=seed)
    morris = morris_analysis.analyze(problem, points, _filled(accuracy_of(points)), num_levels=MORRIS_LEVELS, seed=seed)
    samples = sobol_design.sample(problem, base_samples, calc_second_order=False, seed=seed)
    sobol = sobol_analysis.analyze(problem, _filled(accuracy_of(samples)), calc_second_order=False, seed=seed)
    table = pd.DataFrame(
        {
            "parameter": names,
            "range": ranges.accuracy_range,
            "is_critical": np.isin(np.arange(len(names)), ranges.critical_parameters[:num_critical]),
            "morris_mu_star": np.asarray(morris["mu_star"], float),
            "morris_mu_star_conf95": np.asarray(morris["mu_star_conf"], float),
            "morris_sigma": np.asarray(morris["sigma"], float),
            "sobol_first": sobol["S1"],
            "sobol_total": sobol["ST"],
            "sobol_total_conf95": sobol["ST_conf"],
        }
    )
    return table, {"range": array.num_cases, "morris": len(points), "sobol": len(samples)}


def agreement(table: pd.DataFrame, num_critical: int) -> dict[str, float]:
    """Return how far the range agrees with the other two: ranks of all parameters, and Eq. 37 of the K first."""
    first = {name: table.nlargest(num_critical, name)["parameter"].tolist() for name in INDICES}
    agreed: dict[str, float] = {"similarity_by_chance": chance_similarity(num_critical, len(table))}
    for name in INDICES[1:]:
        agreed[f"rank_correlation_with_{name}"] = float(
            np.corrcoef(rankdata(table["range"]), rankdata(table[name]))[0, 1]
        )
        agreed[f"similarity_with_{name}"] = similarity_index(first["range"], first[name])
    return agreed


def influence_figure(table: pd.DataFrame) -> str:
    """Return the three indices side by side, each in its own unit."""
    ordered = table.sort_values("sobol_total", ascending=True, ignore_index=True)

    def draw(grid: list[list[Axes]]) -> None:
        for axes, name, error, title in zip(
            grid[0], INDICES, (None, "morris_mu_star_conf95", "sobol_total_conf95"),
            ("range (Eq. 15)", "Morris, mu*", "Sobol, total"), strict=True,
        ):  # fmt: skip
            spread = None if error is None else ordered[error]
            axes.barh(range(len(ordered)), ordered[name], xerr=spread, color=AFTER, alpha=0.75)
            axes.set_yticks(range(len(ordered)), ordered["parameter"] if axes is grid[0][0] else [""] * len(ordered))
            axes.set_title(f"{title} of the accuracy", fontsize=8)

    return svg_grid(draw, 1, 3, 8.0, 0.24 * len(table) + 1.0)


def _filled(accuracy: np.ndarray) -> np.ndarray:
    is_ok = np.isfinite(accuracy)
    if not is_ok.any():
        raise RuntimeError("no candidate succeeded; narrow the bounds, or doubt the scenario")
    return np.where(is_ok, accuracy, accuracy[is_ok].min())
