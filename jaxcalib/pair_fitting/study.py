"""All pairs of a file: fitted on their first part, judged on the rest, with what they say of the population."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxcalib.pair_fitting.batch import DESIRED_SPEED
from jaxcalib.pair_fitting.fit import PairFit, fit_pairs, mixed_errors
from jaxcalib.pair_fitting.recorded_pairs import FEWEST_STEPS, RecordedPair
from sim_adapters.atomic_file import write_atomically
from surrogate.vehicle.model_entry import ModelEntry

QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


@dataclass(frozen=True)
class PairStudy:
    """What the pairs of a file say.

    Attributes:
        model: name of the model.
        table: one row per pair: each parameter with its standard error and whether it is identified, the mixed error
            on the fitted and on the held-out part, whether the fitted follower would have hit its leader.
        population: for each parameter, over the pairs that identify it: their share, mean, standard deviation and
            quantiles; None where fewer than two do.
        dropped: pairs that were left out, and why.
    """

    model: str
    table: pd.DataFrame
    population: dict[str, dict[str, Any] | None]
    dropped: tuple[str, ...]

    @property
    def median_error(self) -> float | None:
        """Median of the mixed errors where pairs were fitted."""
        return _median(self.table["mixed_error"].to_numpy(float))

    @property
    def median_error_held_out(self) -> float | None:
        """Median of the mixed errors on what was held out; None where nothing was."""
        return _median(self.table["mixed_error_held_out"].to_numpy(float))

    def write(self, folder: Path) -> None:
        """Write pairs.csv and population.json."""
        folder.mkdir(parents=True, exist_ok=True)
        rows = self.table.to_csv(index=False, float_format="%.6g")
        write_atomically(folder / "pairs.csv", lambda stream: stream.write(rows.encode()))
        content = {
            "model": self.model,
            "num_pairs": len(self.table),
            "median_mixed_error": self.median_error,
            "median_mixed_error_held_out": self.median_error_held_out,
            "parameters": self.population,
            "dropped": self.dropped,
        }
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        write_atomically(folder / "population.json", lambda stream: stream.write(f"{text}\n".encode()))


def study_pairs(
    entry: ModelEntry,
    pairs: Sequence[RecordedPair],
    dropped: Sequence[str] = (),
    held_out_share: float = 0.5,
    seed: int = 0,
    on_pairs: Callable[[int], None] = lambda number: None,
) -> PairStudy:
    """Fit a model to pairs; of each pair a last part may be held out. Those dropped say why."""
    ends = [len(pair) - round(held_out_share * len(pair)) for pair in pairs]
    fitted = [pair.part(0, end) for pair, end in zip(pairs, ends, strict=True)]
    fits = fit_pairs(entry, fitted, seed, on_pairs)
    held_out = np.full(len(pairs), np.nan)
    places = [place for place, pair in enumerate(pairs) if len(pair) - ends[place] >= FEWEST_STEPS]
    if places:
        others = [pairs[place].part(ends[place], len(pairs[place])) for place in places]
        held_out[places] = mixed_errors(entry, others, np.stack([fits[place].values for place in places]))
    names = [*(one.name for one in entry.parameters), DESIRED_SPEED]
    rows = [_row(names, fit, held_out[place]) for place, fit in enumerate(fits)]
    population = {name: _population(fits, place) for place, name in enumerate(names)}
    return PairStudy(entry.name, pd.DataFrame(rows), population, tuple(dropped))


def _row(names: list[str], fit: PairFit, held_out: float) -> dict[str, Any]:
    row: dict[str, Any] = {"pair_id": fit.name}
    for place, name in enumerate(names):
        row[name] = fit.values[place]
        row[f"{name}_error"] = fit.error[place]
        row[f"{name}_is_identified"] = bool(fit.is_identified[place])
    return row | {
        "mixed_error": fit.mixed_error,
        "mixed_error_held_out": held_out,
        "overlaps": fit.smallest_gap_m < 0.0,
    }


def _population(fits: Sequence[PairFit], place: int) -> dict[str, Any] | None:
    values = np.asarray([fit.values[place] for fit in fits if fit.is_identified[place]])
    if len(values) < 2:
        return None
    return {
        "share_of_pairs": len(values) / len(fits),
        "mean": float(values.mean()),
        "standard_deviation": float(values.std(ddof=1)),
        "quantiles": {f"{share:g}": float(np.quantile(values, share)) for share in QUANTILES},
    }


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
