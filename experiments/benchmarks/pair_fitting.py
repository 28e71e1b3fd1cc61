"""`python -m experiments.benchmarks.pair_fitting`: fit-following against scipy's differential evolution.

The same pairs, the same objective, the same simulator: differential evolution with scipy's defaults, its population
evaluated as one batch, pair after pair. Both fit the first half of each pair and are judged on the second.
"""

import json
import time
from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from scipy.optimize import differential_evolution

from experiments.results.record import record as keep
from jaxcalib.pair_fitting.batch import bounds_of, misfit, pair_batch
from jaxcalib.pair_fitting.fit import fit_pairs, mixed_errors
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair, read_pairs
from surrogate.car_following.registry import car_following_model
from surrogate.vehicle.model_entry import ModelEntry

DATA_SETS = ("openacc_astazero", "openacc_zalazone", "ngsim_i80_human_pairs")
SHORTEST = 256  # steps; arrays have a power of 2 times that, so that one program serves many pairs
WORST = 1e6  # misfit of what is no number
app = App(name="experiments.benchmarks.pair_fitting", help="Fits of pairs against differential evolution.")


def evolve(entry: ModelEntry, pair: RecordedPair, seed: int) -> np.ndarray:
    """Return the values that differential evolution finds for a pair."""
    bounds, steps = bounds_of(entry), SHORTEST
    while steps < len(pair):
        steps *= 2
    batch = pair_batch([pair], piece_steps=steps)

    def evaluate(columns: np.ndarray) -> np.ndarray:
        units = jnp.asarray(columns[:, :, None], jnp.float32)
        misfits = np.asarray(misfit(entry, bounds, units, batch), float)[:, 0]
        return np.where(np.isfinite(misfits), misfits, WORST)

    num_parameters = len(entry.parameters) + 1
    solution = differential_evolution(
        evaluate, [(0.0, 1.0)] * num_parameters, vectorized=True, updating="deferred", polish=False, rng=seed
    )
    return np.asarray(bounds.values(jnp.asarray(solution.x, jnp.float32)), float)


@app.default
def compare(
    *,
    data: Path = Path("../shared/data"),
    model: str = "idm",
    every: Annotated[int, Parameter(validator=Number(gte=1))] = 1,
    seed: int = 0,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Print one line of JSON for each data set.

    Parameters
    ----------
    data
        Folder of the recordings.
    model
        Car-following model.
    every
        Differential evolution takes every so many pairs, in the order of the file, and so does fit-following beside it.
    seed
        Of both.
    record
        Also write the table to experiments/results.
    """
    entry = car_following_model(model)
    rows = []
    for name in DATA_SETS:
        everyone, dropped = read_pairs(data / "car_following" / f"{name}.csv.gz", drops_bad=True)
        pairs = everyone[::every]
        fitted = [pair.part(0, len(pair) // 2) for pair in pairs]
        judged = [pair.part(len(pair) // 2, len(pair)) for pair in pairs]
        began = time.perf_counter()
        fits = fit_pairs(entry, fitted, seed)
        ours_s = time.perf_counter() - began
        ours = mixed_errors(entry, judged, np.stack([fit.values for fit in fits]))
        began = time.perf_counter()
        values = np.stack([evolve(entry, pair, seed) for pair in fitted])
        theirs_s = time.perf_counter() - began
        theirs = mixed_errors(entry, judged, values)
        result = {
            "data_set": name,
            "model": entry.name,
            "pairs": len(pairs),
            "left_out": len(dropped),
            "fit_following": {
                "wall_s": ours_s,
                "median_error": float(np.median([fit.mixed_error for fit in fits])),
                "median_error_held_out": float(np.median(ours)),
            },
            "differential_evolution": {
                "wall_s": theirs_s,
                "median_error": float(np.median(mixed_errors(entry, fitted, values))),
                "median_error_held_out": float(np.median(theirs)),
            },
            "time_ratio": theirs_s / ours_s,
        }
        print(json.dumps(result), flush=True)
        rows.append(result)
    if record:
        title = f"Fits of pairs against differential evolution: {entry.name}"
        keep("performance", f"pair_fitting-{entry.name}", rows, title)
    return 0


if __name__ == "__main__":
    app()
