"""The tables of a comparison with SUMO as records in experiments/results."""

from typing import Any

from experiments.results.record import record

CURVES = "roc"  # drawn, and too long for a table
TITLES = {
    "parity": ("car_following", "Car-following, step by step: largest difference in position"),
    "lane_changes": ("lane_changes", "Recorded lane-change decisions"),
    "equilibrium": ("equilibrium", "Flow at given density, against the closed form"),
    "equilibrium_in_sumo": ("equilibrium_in_sumo", "Flow at given density, W99 against SUMO"),
    "timed_lane_changes": ("timed_lane_changes", "Lane changes that take time"),
    "insertion": ("insertion", "Inserted over scheduled"),
}


def record_tables(tables: dict[str, Any]) -> None:
    """Write what was compared into the study of fidelity."""
    notes = [f"SUMO {tables['sumo']}; case `{tables['case']}`."]
    for key, (name, title) in TITLES.items():
        if key in tables:
            rows = [{column: cell for column, cell in row.items() if column != CURVES} for row in tables[key]]
            record("fidelity", name, rows, title, notes)
    if "transfer" in tables:
        _record_transfer(tables["transfer"], notes)


def _record_transfer(transfer: dict[str, Any], notes: list[str]) -> None:
    runs, failed = transfer["runs_per_case"], transfer["num_failed"]
    counted = [effect for effect in transfer["effects"] if effect["counts"]]
    ratios = [effect["surrogate"] / effect["sumo"] for effect in counted]
    counts = [
        f"{transfer['array']}; runs of each case: {runs['surrogate']} in the surrogate, {runs['sumo']} in SUMO; "
        f"cases failed: {failed['surrogate']} and {failed['sumo']}.",
        f"Main effects beyond SUMO's noise: {len(counted)}; sign right in {sum(ratio > 0.0 for ratio in ratios)}, "
        f"size within 25 % in {sum(abs(ratio - 1.0) <= 0.25 for ratio in ratios)}.",
    ]
    record("fidelity", "transfer", transfer["measures"], "Transfer of measures, surrogate against SUMO", notes + counts)
