"""Tables and figures of a study, drawn from its data alone."""

from pathlib import Path


def write_report(out: Path) -> str:
    """Write the comparison with the paper and the figures of a study; return what a person wants to read first.

    Raises:
        CaseError: there is no study.
    """
    from experiments.paper.comparison import comparison_table, summary_table
    from experiments.paper.figures import all_figures
    from experiments.paper.study import read_study
    from sim_adapters.atomic_file import write_atomically

    _, trials = read_study(out)
    comparison, summary = comparison_table(trials), summary_table(trials)
    for name, table in (("comparison", comparison), ("summary", summary)):
        write_atomically(out / f"{name}.csv", lambda file, table=table: table.to_csv(file, index=False))
    for name, text in all_figures(trials).items():
        write_atomically(out / f"{name}.svg", lambda file, text=text: file.write(text.encode()))
    return f"{summary.to_string(index=False)}\n\n{comparison.to_string(index=False)}\n\nfigures: {out}"
