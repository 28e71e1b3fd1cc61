"""The command line."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from jaxcalib.cli.compilation_cache import keep_compiled_programs
from jaxcalib.cli.hand_over import dossier, export
from jaxcalib.importers.registry import IMPORTERS

app = App(name="jaxcalib", help="Calibrate SUMO traffic around automated vehicles from their logs.")


@app.command
def calibrate(
    case: Path,
    /,
    *,
    out: Path,
    seed: Annotated[int, Parameter(validator=Number(gte=0, lte=2000))] = 0,
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100.0))] = 1.0,
    resume: Annotated[bool, Parameter(negative="")] = False,
    settings: Path | None = None,
    engine: Literal["auto", "surrogate", "sumo"] = "auto",
    cluster: str | None = None,
    profile: Annotated[bool, Parameter(negative="")] = False,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Calibrate demand and driver behaviour of a case.

    Leaves result.json, report.html and scenario/ (SUMO files with the calibrated values) in the folder given by --out.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for the results; it must be empty or not there yet.
    seed
        Seed of all random numbers; the same seed gives the same result.
    budget
        Factor on the numbers of simulation runs: 0.5 is quick, 2 is thorough.
    resume
        Go on with a calibration that was stopped.
    settings
        TOML file with further options (docs/settings.md).
    engine
        Simulator that makes the search's runs: the surrogate where it can follow the scenario (auto), or SUMO alone.
    cluster
        Address of a dask scheduler whose workers make SUMO's runs (docs/cluster.md).
    profile
        Say at the end where the time went, by kind of work, and keep it in the result.
    quiet
        Say nothing but errors.
    """
    from jaxcalib.calibration.pipeline import calibrate as run
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.cli.profile_table import print_profile
    from jaxcalib.cli.terminal import TerminalProgress, summary
    from jaxcalib.runs.profile import profiled
    from jaxcalib.runs.progress import Silent

    def work() -> str:
        with profiled(profile), Silent() if quiet else TerminalProgress() as progress:
            result = run(
                case, out, seed=seed, budget=budget, resume=resume, settings=settings, engine=engine,
                cluster=cluster, progress=progress,
            )  # fmt: skip
            print_profile()
        return "" if quiet else summary(result, out)

    return guarded(work, f"go on with: jaxcalib calibrate {case} --out {out} --resume", out)


@app.command
def check(case: Path, /, *, out: Path | None = None) -> int:
    """Say how well the surrogate can follow a case's scenario, part by part, before any long work.

    Parts that it cannot follow are left to SUMO alone: calibrate then searches in SUMO. Leaves a page that shows what
    was understood of the logs.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        The page to write; CASE/check.html unless given.
    """
    from jaxcalib.check.scenario_check import CaseCheck, check_case
    from jaxcalib.cli.check_table import leave_page, print_check
    from jaxcalib.cli.guarded import guarded

    found: list[CaseCheck] = []

    def work() -> str:
        found.append(check_case(case))
        return ""

    if code := guarded(work, "nothing was changed."):
        return code
    code, page = print_check(found[0]), out or case / "check.html"
    return guarded(lambda: leave_page(found[0], page), "no figure was written.") or code


@app.command(name="import")
def import_(
    form: Literal[tuple(IMPORTERS)],  # pyright: ignore[reportInvalidTypeForm]
    source: Path,
    /,
    *,
    out: Path,
    scenario: Path | None = None,
    subject: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (),
    probes: Annotated[int, Parameter(validator=Number(gte=1, lte=1000))] = 8,
    range_m: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1000))] = None,
    occlusion: Annotated[bool, Parameter(negative="")] = False,
    begin_s: Annotated[float | None, Parameter(validator=Number(gte=0, lte=1e7))] = None,
    mapping: Path | None = None,
    crs: str | None = None,
) -> int:
    """Make a case of a recording in another format, and check it.

    Traffic seen from above becomes logs as chosen vehicles would have recorded them. Where the recording shows a
    straight road and no scenario is given, one is made of it.

    Parameters
    ----------
    form
        Format of the recording (docs/import.md).
    source
        File or folder of the recording.
    out
        Folder for the case; it must be empty or not there yet.
    scenario
        SUMO configuration (.sumocfg) of the road.
    subject
        Ids of the vehicles that are taken for subject vehicles; chosen by the program unless given.
    probes
        How many are chosen in each recording.
    range_m
        Range of their sensors, ahead and behind; 150 m, or less on a short stretch.
    occlusion
        Vehicles that are hidden behind others are not seen.
    begin_s
        When the recording begins, on the scenario's clock; 600 s, or the recording's own clock if it is the scenario's.
    mapping
        TOML file with the names that the format leaves open: columns, topics (docs/import.md).
    crs
        Coordinate reference system of places, for example EPSG:2229, where the format leaves it open.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.importers.import_case import import_case
    from jaxcalib.importers.importer import ImportOptions

    options = ImportOptions(subject, probes, range_m, occlusion, begin_s, mapping, crs, scenario)

    def work() -> str:
        return "\n".join([*import_case(form, source, out, options), f"{out / 'case.toml'} is written."])

    if code := guarded(work, "nothing was written."):
        return code
    if code := check(out):
        print(
            f"jaxcalib: {out} is kept, with {out / 'check.html'}: mend it, or remove it and import again.",
            file=sys.stderr,
        )
    return code


@app.command
def new(
    case: Path,
    /,
    *,
    scenario: Path,
    drive: Annotated[tuple[tuple[Path, Path], ...], Parameter(consume_multiple=True, negative="")],
    subject: str | None = None,
    log: Path | None = None,
) -> int:
    """Make a case of a SUMO scenario and logs, which stay where they are, and check it.

    Writes case.toml, with a comment at each line that is a guess. Where the scenario has no subject vehicle, one is
    added along the logged route, in a route file and a configuration of the case's own.

    Parameters
    ----------
    case
        Folder for the case; it must be empty or not there yet.
    scenario
        SUMO configuration (.sumocfg).
    drive
        Tables of a drive: the subject vehicle's, then the detected vehicles'. Any number of such pairs.
    subject
        Id of the subject vehicle; found, or added, unless given.
    log
        TOML file with section [log]: names, units and clock of the tables' columns (docs/case.md); Table 1 otherwise.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.new_case.new_case import make_case

    def work() -> str:
        return "\n".join([*make_case(case, scenario, drive, subject, log), f"{case / 'case.toml'} is written."])

    return guarded(work, "nothing was written.") or check(case)


@app.command
def diagnose(
    case: Path,
    /,
    *,
    out: Path,
    seed: Annotated[int, Parameter(validator=Number(gte=0, lte=2000))] = 0,
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100.0))] = 1.0,
    resume: Annotated[bool, Parameter(negative="")] = False,
    cluster: str | None = None,
    profile: Annotated[bool, Parameter(negative="")] = False,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Tell where simulation and road differ, which missing effect causes it, and how far adding it closes the gap.

    Leaves diagnosis.json and diagnosis.html in the folder given by --out.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for the results; it must be empty or not there yet.
    seed
        Seed of all random numbers; the same seed gives the same result.
    budget
        Factor on the numbers of simulation runs: 0.5 is quick, 2 is thorough.
    resume
        Go on with a diagnosis that was stopped.
    cluster
        Address of a dask scheduler whose workers make SUMO's runs (docs/cluster.md).
    profile
        Say at the end where the time went, by kind of work, and keep it in the result.
    quiet
        Say nothing but errors.
    """
    from jaxcalib.cli.diagnosis_summary import summary
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.cli.profile_table import print_profile
    from jaxcalib.cli.terminal import TerminalProgress
    from jaxcalib.diagnosis.run import diagnose as run
    from jaxcalib.runs.profile import profiled
    from jaxcalib.runs.progress import Silent

    def work() -> str:
        with profiled(profile), Silent() if quiet else TerminalProgress() as progress:
            found = run(case, out, seed=seed, budget=budget, resume=resume, cluster=cluster, progress=progress)
            print_profile()
        return "" if quiet else summary(found, out)

    return guarded(work, f"go on with: jaxcalib diagnose {case} --out {out} --resume", out)


@app.command
def fit_following(
    pairs: Path,
    /,
    *,
    out: Path,
    model: str = "idm",
    held_out_share: Annotated[float, Parameter(validator=Number(gte=0.0, lte=0.8))] = 0.5,
    drop_bad_pairs: Annotated[bool, Parameter(negative="")] = False,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
) -> int:
    """Fit a car-following model to recorded leader-follower pairs, all at once.

    Leaves pairs.csv (parameters, standard errors and errors of each pair) and population.json in the folder of --out.

    Parameters
    ----------
    pairs
        Table with the columns pair_id, time_s, v_lead_mps, v_foll_mps and gap_m (.csv, .csv.gz or .parquet).
    out
        Folder for the results.
    model
        Car-following model, for example idm, krauss or w99-sumo128; docs/parameters.md lists them all.
    held_out_share
        Last part of each pair that is not fitted but judged.
    drop_bad_pairs
        Leave out pairs with gaps of 0 or less, without a leader, or with jumps in time, instead of stopping.
    seed
        Seed of the starts.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.cli.pair_fitting_terminal import pair_progress, print_summary
    from jaxcalib.errors import CaseError
    from jaxcalib.pair_fitting.pair_physics import believed_pairs
    from jaxcalib.pair_fitting.recorded_pairs import read_pairs
    from jaxcalib.pair_fitting.study import study_pairs
    from jaxcalib.runs.disk import check_out, writing_to
    from surrogate.car_following.registry import car_following_model
    from surrogate.vehicle.model_entry import UnknownModelError

    def work() -> str:
        try:
            entry = car_following_model(model)
        except UnknownModelError as error:
            raise CaseError("command line", "--model", f"expected a known name: {error}") from None
        check_out(out)
        recorded, dropped = read_pairs(pairs, drop_bad_pairs)
        recorded, doubted = believed_pairs(pairs, recorded)
        with pair_progress(len(recorded)) as on_pairs:
            study = study_pairs(entry, recorded, [*dropped, *doubted], held_out_share, seed, on_pairs)
        with writing_to(out):
            study.write(out)
        print_summary(study, out)
        return ""

    return guarded(work, "nothing was written.")


@app.command
def effects() -> int:
    """List the effects that a simulation may lack: where each acts, its unit, range of strength and source."""
    from jaxcalib.cli.effect_list import print_effects

    print_effects()
    return 0


@app.command
def sweep(
    case: Path | None = None,
    /,
    *,
    out: Path,
    design: str = "sobol:1024",
    seeds: Annotated[int, Parameter(validator=Number(gte=1))] = 4,
    engine: Literal["surrogate", "sumo"] = "surrogate",
    seed: Annotated[int, Parameter(validator=Number(gte=0, lte=2000))] = 0,
    parameters: Annotated[tuple[str, ...] | None, Parameter(consume_multiple=True, negative="")] = None,
    settings: Path | None = None,
    shard: str | None = None,
    merge: Annotated[bool, Parameter(negative="")] = False,
    cluster: str | None = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
    profile: Annotated[bool, Parameter(negative="")] = False,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Run many parameter sets on several seeds each, and keep every run as a row of a table.

    The same command goes on with a sweep that was stopped. Leaves the table, and beside it a .json and a .html file.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        The table to write; its name ends in .parquet.
    design
        sobol:N, latin-hypercube:N, grid:LEVELS, orthogonal-array:LEVELS, or a table of your own (.csv, .parquet).
    seeds
        Runs of each candidate; all candidates have the same seeds.
    engine
        Simulator: surrogate or sumo.
    seed
        Seed of all random numbers.
    parameters
        Names of the parameters that vary; all of them unless given. The others keep the scenario's values.
    settings
        TOML file with bounds (docs/settings.md).
    shard
        Part that this job makes, for example 3/8; all jobs share the folder of --out. Then --merge.
    merge
        Check that nothing is missing of what the jobs have made, and write the table.
    cluster
        Address of a dask scheduler whose workers make the runs (docs/cluster.md).
    resume
        Insist on a sweep that was begun.
    profile
        Say at the end where the time went, by kind of work, and keep it in the result.
    quiet
        Say nothing but errors.
    """
    from jaxcalib.cli.sweep_command import SweepOptions, run_sweep

    options = SweepOptions(
        design=design, seeds=seeds, engine=engine, seed=seed, parameters=parameters, settings=settings, shard=shard,
        cluster=cluster, resume=resume,
    )  # fmt: skip
    return run_sweep(case, out, options, merge=merge, profile=profile, quiet=quiet)


@app.command
def validate(
    case: Path,
    run: Path,
    /,
    *,
    out: Path | None = None,
    seeds: Annotated[int, Parameter(validator=Number(gte=3, lte=1000))] = 20,
    drives: Literal["held_out", "fit"] | None = None,
    counts: Path | None = None,
    margins: Path | None = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
    cluster: str | None = None,
    profile: Annotated[bool, Parameter(negative="")] = False,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Judge a calibrated result by the field, in SUMO alone: every criterion with its standard, pass or fail.

    Leaves validation.json and validation.html. The exit code does not depend on whether criteria pass.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    run
        Folder that `jaxcalib calibrate` has left.
    out
        Folder for the results; RUN/validation unless given.
    seeds
        Rounds of drives: each drive is run once in each.
    drives
        Role of the drives to judge by: held_out or fit; held-out drives where there are any.
    counts
        Table of counted vehicles (docs/validate.md); GEH and FHWA 2019 need one.
    margins
        TOML file with margins within which quantities count as the same (docs/validate.md).
    resume
        Go on with a validation that was stopped.
    cluster
        Address of a dask scheduler whose workers make SUMO's runs (docs/cluster.md).
    profile
        Say at the end where the time went, by kind of work, and keep it in the result.
    quiet
        Say nothing but errors.
    """
    from jaxcalib.cli.validate_command import ValidateOptions, run_validation

    return run_validation(
        ValidateOptions(case, run, out, seeds, drives, counts, margins, resume, cluster, profile, quiet)
    )


app.command(dossier)
app.command(export)


def main() -> None:
    """Run the command line."""
    keep_compiled_programs()
    sys.exit(app())
