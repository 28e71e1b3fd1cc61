"""`python -m experiments.diagnosis_bank`: keeps what diagnoses ran, and judges it anew."""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console

from experiments.blind_effects.run import ANSWER, case_folders
from experiments.blind_effects.score import score_answers
from experiments.blind_effects.score_table import recorded_case, recorded_line
from experiments.blind_effects.seal import file_hash
from experiments.diagnosis_bank.fill import fill_bank, write_answer
from experiments.diagnosis_bank.kept_case import KeptCase, NotKeptError
from experiments.diagnosis_bank.links import LINKS, without
from experiments.diagnosis_bank.made_up_nulls import by_road, judge_made_up_nulls
from experiments.results.record import record as keep
from experiments.results.terminal import as_table, write_json

app = App(name="experiments.diagnosis_bank", help="A bank of diagnosed cases.")


@app.command
def fill(cases: Path, bank: Path, /, *, first: Annotated[int | None, Parameter(validator=Number(gte=1))] = None) -> int:
    """Diagnose cases, one per core, and keep all that was run; the same command goes on where it was stopped.

    Parameters
    ----------
    cases
        Folder of cases.
    bank
        Folder for what was run.
    first
        Only so many cases.
    """
    for name, said in fill_bank(case_folders(cases), bank, first):
        print(name, said, flush=True)
    return 0


@app.command
def judge(
    cases: Path,
    bank: Path,
    out: Path,
    /,
    *,
    off: list[str] | None = None,
    may_run: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Judge all cases of a bank anew, and write answers for `experiments.blind_effects score`.

    Parameters
    ----------
    cases
        Folder of cases.
    bank
        Folder that `fill` made.
    out
        Folder for the answers.
    off
        Links of the inference to switch off.
    may_run
        Make runs that the bank does not hold, and keep them; otherwise such cases are left out and said.
    """
    _check_links(off)
    console = Console()
    hashes = {}
    for case in kept_cases(cases, bank):
        folder = case.case
        began_s = time.perf_counter()
        try:
            with without(off or ()), case.session(may_run) as session:
                findings, diagnosis = case.diagnosed(session)
                write_answer(out / folder.name / ANSWER, diagnosis)
                hashes[folder.name] = file_hash(out / folder.name / ANSWER)
                twin = cases / "twins" / folder.name
                if twin.is_dir() and findings is not None and diagnosis.effects:
                    file = out / f"{folder.name}_twin" / ANSWER
                    write_answer(file, case.on_twin(twin, session, findings))
                    hashes[file.parent.name] = file_hash(file)
        except NotKeptError as error:
            console.print(f"{folder.name}: not kept: {error}")
            continue
        console.print(f"{folder.name}: {diagnosis.verdict} {' '.join(diagnosis.effects)} "
                      f"({time.perf_counter() - began_s:.1f} s)")  # fmt: skip
    write_json(out / "answers.json", hashes)
    return 0


@app.command
def record(cases: Path, answers: Path, title: str, /, *, key: Path, name: str) -> int:
    """Score answers on sealed cases, as `experiments.blind_effects score` does, and keep the tables in results.

    Parameters
    ----------
    cases
        Folder of the cases.
    answers
        Folder of the answers.
    title
        What the tables are called.
    key
        The labels.
    name
        Name of the tables in the file; one of the same name is replaced.
    """
    lines, rows = score_answers(cases, answers, key, (), answers, Console())
    note = "Answers of `judge` on kept runs: times are those of judging, not of a diagnosis; twins have the same fit."
    keep("diagnosis", name, [recorded_line(line) for line in lines if line.of], title, [note])
    keep("diagnosis", f"{name}_cases", [recorded_case(row) for row in rows], f"{title}, case by case")
    return 0


@app.command
def nulls(
    cases: Path,
    bank: Path,
    /,
    *,
    fields: Annotated[int, Parameter(validator=Number(gte=1))] = 4,
    off: list[str] | None = None,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Judge fields made of kept null runs, by road: how often something is seen where nothing is.

    Parameters
    ----------
    cases
        Folder of cases.
    bank
        Folder that `fill` made.
    fields
        Fields of each case.
    off
        Links of the inference to switch off.
    record
        Keep the table in results.
    """
    _check_links(off)
    found = []
    for case in kept_cases(cases, bank):
        with without(off or ()):
            said = list(judge_made_up_nulls(case, fields))
        print(case.case.name, *(each.kind for each in said), flush=True)
        found += said
    rows = by_road(found)
    title = "Fields without any effect, made of null runs, by road"
    Console().print(as_table(rows, title))
    if record:
        keep("diagnosis", "made_up_nulls", rows, title)
    return 0


def kept_cases(cases: Path, bank: Path) -> Iterator[KeptCase]:
    """Return the cases of a folder that a bank holds; twins have no runs of their own."""
    for folder in case_folders(cases):
        if folder.parent.name != "twins" and (bank / folder.name / ANSWER).is_file():
            yield KeptCase(folder, bank / folder.name)


def _check_links(names: Sequence[str] | None) -> None:
    for name in names or ():
        if name not in LINKS:
            raise SystemExit(f"--off: expected one of {', '.join(LINKS)}, got {name}.")


if __name__ == "__main__":
    raise SystemExit(app())
