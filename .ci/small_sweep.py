"""A sweep of two runs in each simulator, for an installation without extras: `python .ci/small_sweep.py`.

Ends with an error unless all runs are good and their traffic moves.
"""

import platform
import tempfile
from importlib.metadata import version
from pathlib import Path

import jaxcalib
from jaxcalib.sweeps.plan import ENGINES

CASE = Path(__file__).parents[1] / "experiments" / "cases" / "corridor"
NUM_RUNS = 2


def main() -> None:
    """Make the sweeps and judge them."""
    where = f"Python {platform.python_version()}, jax {version('jax')}, numpy {version('numpy')}"
    with tempfile.TemporaryDirectory() as folder:
        for engine in ENGINES:
            table = Path(folder) / f"{engine}.parquet"
            result = jaxcalib.sweep(CASE, table, design=f"grid:{NUM_RUNS}", parameters=["tau"], seeds=1, engine=engine)
            speeds_mps = result.table()["traffic_speed_mps"]
            found = f"{where}: {engine}: {result.statuses}, traffic at {', '.join(f'{v:.1f}' for v in speeds_mps)} m/s"
            if result.statuses != {"OK": NUM_RUNS} or not (speeds_mps > 1.0).all():
                raise SystemExit(f"small sweep failed: {found}")
            print(found, flush=True)


if __name__ == "__main__":  # SUMO runs in processes of its own, which import this file
    main()
