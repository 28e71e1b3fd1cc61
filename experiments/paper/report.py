"""Tables and figures of a study, drawn from its data alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any


def write_report(out: Path, others: Sequence[Path] = (), is_recorded: bool = False) -> str:
    """Write the comparison with the paper and the figures of a study; return what a person wants to read first.

    Trials of other folders of the same study count, too. Where it is recorded, tables and figures go to
    experiments/results.

    Raises:
        CaseError: there is no study, or another folder is of another one.
    """
    from experiments.paper.ablation import ablation_table, is_ablation
    from experiments.paper.comparison import by_pattern_table, comparison_table, summary_table, with_all_methods
    from experiments.paper.figures import all_figures
    from experiments.paper.recovery import read_truth, recovery_table
    from experiments.paper.study import CASES, read_parts
    from sim_adapters.atomic_file import write_atomically

    about, trials = read_parts((out, *others))
    complete = len({(one.pattern, one.repetition) for one in with_all_methods(trials)})
    means = f"Errors of all methods are means over the {complete} of them that every method has made."
    figures, truth, recorded_figures = all_figures(trials), None, {}
    if is_ablation(trials):
        tables = {"ablation": ("What each part of the method buys", ablation_table(trials))}
        means = (
            "Variants are compared with the method as improved on what both have made. One trial says little of small "
            "changes: with another seed the method's own vehicle-level error on a pattern moves by 0.1 to 0.4 "
            "(standard deviation), mostly by its rare cut-ins."
        )
    else:
        recorded_figures = figures
        tables = {
            "comparison": ("The paper's numbers beside ours", comparison_table(trials)),
            "by_pattern": ("Vehicle-level error by pattern", by_pattern_table(trials)),
            "summary": ("Errors of all methods", summary_table(trials)),
        }
        truth = read_truth([folder / CASES for folder in (out, *others)])
    if truth is not None:
        tables["recovery"] = (
            "Off by from what simulated patterns were made with, %",
            recovery_table(with_all_methods(trials), truth),
        )
    for name, (_, table) in tables.items():
        write_atomically(out / f"{name}.csv", lambda file, table=table: table.to_csv(file, index=False))
    for name, text in figures.items():
        write_atomically(out / f"{name}.svg", lambda file, text=text: file.write(text.encode()))
    if is_recorded:
        _record(about, dict(tables.values()), recorded_figures, means)
    return "\n\n".join([*(table.to_string(index=False) for _, table in tables.values()), f"figures: {out}"])


def _record(about: dict[str, Any], tables: dict[str, Any], figures: dict[str, str], means: str) -> None:
    """Keep a study in the results: tables, data frames by title, in which what is not known stays empty; figures."""
    from experiments.results import record as results

    case, num_patterns = about["case"], len(about["patterns"])
    note = (
        f"{num_patterns} traffic patterns, {about['repetitions']} repetitions, {', '.join(about['methods'])}; "
        f"budget {about['budget']:g}; failed: {', '.join(about['failed']) or 'none'}. {means}"
    )
    for title, table in tables.items():
        rows = table.astype(object).where(table.notna(), None).to_dict("records")
        results.record("paper", f"{case}: {title}", rows, f"{title} on `{case}`", [note])
    if not figures:
        return
    pictures = []
    for name, text in figures.items():
        file = results.FOLDER / f"paper_{case}_{name}.svg"
        file.write_text(text, encoding="utf-8")
        _, number, *words = name.split("_")
        pictures.append(f"![Figure {int(number)}: {' '.join(words)}]({file.name})")
    title = "Figures 7 to 13 of the paper"
    results.record("paper", f"{case}: {title}", [], f"{title} on `{case}`", pictures)
