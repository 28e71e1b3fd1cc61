"""Tables and figures of a study, drawn from its data alone."""

from pathlib import Path
from typing import Any


def write_report(out: Path, is_recorded: bool = False) -> str:
    """Write the comparison with the paper and the figures of a study; return what a person wants to read first.

    Where it is recorded, both tables go to experiments/results, too.

    Raises:
        CaseError: there is no study.
    """
    from experiments.paper.comparison import comparison_table, summary_table
    from experiments.paper.figures import all_figures
    from experiments.paper.study import read_study
    from sim_adapters.atomic_file import write_atomically

    about, trials = read_study(out)
    comparison, summary = comparison_table(trials), summary_table(trials)
    for name, table in (("comparison", comparison), ("summary", summary)):
        write_atomically(out / f"{name}.csv", lambda file, table=table: table.to_csv(file, index=False))
    if is_recorded:
        _record(about, {"Errors of all methods": summary, "The paper's numbers beside ours": comparison})
    for name, text in all_figures(trials).items():
        write_atomically(out / f"{name}.svg", lambda file, text=text: file.write(text.encode()))
    return f"{summary.to_string(index=False)}\n\n{comparison.to_string(index=False)}\n\nfigures: {out}"


def _record(about: dict[str, Any], tables: dict[str, Any]) -> None:
    """Keep tables of a study, data frames by title, in the results; what is not known stays empty."""
    from experiments.results.record import record

    case, num_patterns = about["case"], len(about["patterns"])
    note = (
        f"{num_patterns} traffic patterns, {about['repetitions']} repetitions, {', '.join(about['methods'])}; "
        f"budget {about['budget']:g}; failed: {', '.join(about['failed']) or 'none'}."
    )
    for title, table in tables.items():
        rows = table.astype(object).where(table.notna(), None).to_dict("records")
        record("paper", f"{case}: {title}", rows, f"{title} on `{case}`", [note])
