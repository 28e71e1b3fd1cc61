"""`python -m experiments.fidelity`: prints and writes how far the surrogate is from SUMO."""

import json
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table

from experiments.fidelity.equilibrium import MOST_DIFFERENCE, NO_EQUILIBRIUM, closed_form_table, sumo_table
from experiments.fidelity.parity import MOST_DIFFERENCE_M, SUMO_MODELS, parity_table

app = App(name="experiments.fidelity", help="How far the surrogate is from SUMO.")


@app.default
def fidelity(
    *, data: Path = Path("../shared/data"), out: Path = Path("fidelity.json"), per_set: Annotated[int, Parameter()] = 5
) -> int:
    """Compare the surrogate with SUMO.

    Parameters
    ----------
    data
        Folder of the recordings; without it, what needs them is left out.
    out
        File for the tables.
    per_set
        Recorded leaders of each data set for the parity of car-following.
    """
    console = Console()
    tables: dict[str, object] = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "sumo": metadata.version("libsumo"),
    }
    _equilibrium(console, tables)
    if (data / "car_following").is_dir():
        rows = parity_table(data, per_set)
        tables["parity"] = rows
        shown = Table(title="car-following parity: largest difference in position, m", caption=f"SUMO {tables['sumo']}")
        for heading in ("model", "leaders", "precision", "median", "largest", f"at most {MOST_DIFFERENCE_M:g}"):
            shown.add_column(heading)
        for model in dict.fromkeys(row["model"] for row in rows):
            for precision in ("double", "single"):
                found = sorted(row[f"{precision}_precision_m"] for row in rows if row["model"] == model)
                verdict = "yes" if found[-1] <= MOST_DIFFERENCE_M else "no"
                middle, largest = f"{found[len(found) // 2]:.2g}", f"{found[-1]:.2g}"
                shown.add_row(model, str(len(found)), precision, middle, largest, verdict)
        console.print(shown)
    else:
        console.print(f"Left out: car-following parity, for {data / 'car_following'} is not there.")
    out.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")
    console.print(f"written: {out}")
    return 0


def _equilibrium(console: Console, tables: dict[str, object]) -> None:
    tables["equilibrium"] = rows = closed_form_table()
    tables["equilibrium_in_sumo"] = in_sumo = sumo_table("W99", SUMO_MODELS["W99"])
    tables["no_equilibrium"] = NO_EQUILIBRIUM
    shown = Table(title="flow at given density: largest difference from closed form or SUMO")
    for heading in ("model", "against", "uniform", "disturbed by 5 %", f"at most {MOST_DIFFERENCE:.0%}"):
        shown.add_column(heading)
    for model in dict.fromkeys(row["model"] for row in rows):
        of_model = [row for row in rows if row["model"] == model]
        largest, disturbed = (
            max(abs(row[key]) for row in of_model) for key in ("relative_difference", "relative_difference_disturbed")
        )
        verdict = "yes" if largest <= MOST_DIFFERENCE else "no"
        waves = " (waves)" if disturbed > MOST_DIFFERENCE else ""
        shown.add_row(model, "closed form", f"{largest:.2%}", f"{disturbed:.1%}{waves}", verdict)
    largest = max(abs(row["relative_difference"]) for row in in_sumo)
    shown.add_row("w99-sumo128", "SUMO", f"{largest:.2%}", "", "yes" if largest <= MOST_DIFFERENCE else "no")
    for model, reason in NO_EQUILIBRIUM.items():
        shown.add_row(model, "-", "-", "", reason)
    console.print(shown)


if __name__ == "__main__":
    app()
