"""How far the values that were found lie from those that a simulated field was made with."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from experiments.paper.methods import label_of
from experiments.paper.patterns import PATTERN_FILE
from experiments.paper.trial import Trial
from jaxcalib.problem.parameter_space import ParameterSpace, parameter_space
from jaxcalib.problem.problem import read_problem

SCALING_FACTOR = 0.5  # of the inflows' ranges, on which nothing here depends


@dataclass(frozen=True)
class Truth:
    """What the simulated patterns of a study were made with."""

    space: ParameterSpace  # its names are those of all values
    values: Mapping[int, Float[np.ndarray, " parameter"]]  # by pattern


def read_truth(folders: Sequence[Path]) -> Truth | None:
    """Return what the patterns in folders of cases were made with; None where none is simulated."""
    files = [file for folder in folders for file in sorted(folder.glob(f"*/{PATTERN_FILE}"))]
    if not files:
        return None
    problem = read_problem(files[0].parent)
    base, layout = problem.template.base_values(), problem.layout
    space = parameter_space(layout, problem.model, base[: layout.num_inputs], SCALING_FACTOR, {})
    values = {}
    for file in files:
        about = json.loads(file.read_text(encoding="utf-8"))
        values[int(about["pattern"])] = np.asarray([about["parameters"][name] for name in space.names], float)
    return Truth(space, values)


def recovery_table(trials: Sequence[Trial], truth: Truth) -> pd.DataFrame:
    """Return a row for each parameter: by how much each method is off, in per cent, the mean over its trials.

    Inflows are off as a share of the truth, driver parameters as a share of their range. What a method leaves alone is
    off by what the scenario is.
    """
    known = [trial for trial in trials if trial.pattern in truth.values]
    num_inputs = truth.space.layout.num_inputs
    table: dict[str, Sequence[str] | np.ndarray] = {
        "parameter": truth.space.names,
        "share of": ["truth" if number < num_inputs else "range" for number in range(len(truth.space.names))],
    }
    for method in dict.fromkeys(trial.method for trial in known):
        off = [_off(trial, truth) for trial in known if trial.method == method]
        table[label_of(method)] = np.round(100.0 * np.mean(off, axis=0), 2)
    return pd.DataFrame(table)


def _off(trial: Trial, truth: Truth) -> Float[np.ndarray, " parameter"]:
    found = np.asarray([trial.parameters[name] for name in truth.space.names], float)
    true, num_inputs = truth.values[trial.pattern], truth.space.layout.num_inputs
    off = np.abs(truth.space.unit_of(found) - truth.space.unit_of(true))
    off[:num_inputs] = np.abs(found[:num_inputs] / true[:num_inputs] - 1.0)
    return off
