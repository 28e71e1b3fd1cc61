"""Progress and summary of a fit of pairs for people at a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from jaxcalib.pair_fitting.study import PairStudy


@contextmanager
def pair_progress(num_pairs: int) -> Iterator[Callable[[int], None]]:
    """Show a bar; yields what is told of pairs that are done."""
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("fitting pairs", total=num_pairs)
        yield lambda number: bar.update(task, advance=number)


def print_summary(study: PairStudy, folder: Path) -> None:
    """Print what the pairs say of the population."""
    console = Console()
    table = Table(title=f"{study.model}, {len(study.table)} pairs")
    for heading in ("parameter", "identified in", "10 %", "median", "90 %"):
        table.add_column(heading)
    for name, one in study.population.items():
        if one is None:
            table.add_row(name, "hardly any", "", "", "")
            continue
        low, middle, high = (f"{one['quantiles'][share]:.3g}" for share in ("0.1", "0.5", "0.9"))
        table.add_row(name, f"{one['share_of_pairs']:.0%}", low, middle, high)
    console.print(table)
    fitted, held_out = (
        "none" if error is None else f"{error:.1%}" for error in (study.median_error, study.median_error_held_out)
    )
    overlapping = int(study.table["overlaps"].to_numpy(bool).sum())
    console.print(f"median error of the gap: {fitted} where fitted, {held_out} held out; {overlapping} overlap")
    for line in study.dropped[:5]:
        console.print(f"left out: {line}", markup=False)
    if len(study.dropped) > 5:
        console.print(f"left out: {len(study.dropped) - 5} more, see population.json")
    console.print(f"written: {folder / 'pairs.csv'}, {folder / 'population.json'}", markup=False)
