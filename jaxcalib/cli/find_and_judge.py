"""Commands that find values and judge them: each is a calculation of minutes."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from jaxcalib.cli.options import Budget, CalibratedRun, CaseFolder, Cluster, Profile, Quiet, Seed, WholeNumber


def calibrate(
    case: CaseFolder,
    /,
    *,
    out: Path,
    seed: Seed = 0,
    budget: Budget = 1.0,
    resume: Annotated[bool, Parameter(negative="")] = False,
    settings: Path | None = None,
    engine: Literal["auto", "surrogate", "sumo"] = "auto",
    cluster: Cluster = None,
    profile: Profile = False,
    quiet: Quiet = False,
) -> int:
    """Calibrate demand and driver behaviour of a case.

    Leaves result.json, report.html and scenario/ (SUMO files with the calibrated values) in the folder given by --out.

    Parameters
    ----------
    out
        Folder for the results; it must be empty or not there yet.
    resume
        Go on with a calibration that was stopped.
    settings
        TOML file with further options (docs/settings.md).
    engine
        Simulator that makes the search's runs: the surrogate where it can follow the scenario (auto), or SUMO alone.
    """
    from jaxcalib.calibration.pipeline import calibrate as run
    from jaxcalib.cli.guarded import guarded, to_go_on
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

    return guarded(work, to_go_on("--resume"), out)


def diagnose(
    case: CaseFolder,
    /,
    *,
    out: Path,
    seed: Seed = 0,
    budget: Budget = 1.0,
    resume: Annotated[bool, Parameter(negative="")] = False,
    cluster: Cluster = None,
    profile: Profile = False,
    quiet: Quiet = False,
) -> int:
    """Tell where simulation and road differ, which missing effect causes it, and how far adding it closes the gap.

    Leaves diagnosis.json and diagnosis.html in the folder given by --out.

    Parameters
    ----------
    out
        Folder for the results; it must be empty or not there yet.
    resume
        Go on with a diagnosis that was stopped.
    """
    from jaxcalib.cli.diagnosis_summary import summary
    from jaxcalib.cli.guarded import guarded, to_go_on
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

    return guarded(work, to_go_on("--resume"), out)


def validate(
    case: CaseFolder,
    run: CalibratedRun,
    /,
    *,
    out: Path | None = None,
    seeds: Annotated[WholeNumber, Parameter(validator=Number(gte=3, lte=1000))] = 20,
    drives: Literal["held_out", "fit"] | None = None,
    counts: Path | None = None,
    margins: Path | None = None,
    half_step: Annotated[bool, Parameter(negative="")] = False,
    resume: Annotated[bool, Parameter(negative="")] = False,
    cluster: Cluster = None,
    profile: Profile = False,
    quiet: Quiet = False,
) -> int:
    """Judge a calibrated result by the field, in SUMO alone: every criterion with its standard, pass or fail.

    Leaves validation.json and validation.html. The exit code does not depend on whether criteria pass.

    Parameters
    ----------
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
    half_step
        Run the rounds with half the scenario's step, too: what is the error of the step?
    resume
        Go on with a validation that was stopped.
    """
    from jaxcalib.cli.validate_command import ValidateOptions, run_validation

    return run_validation(
        ValidateOptions(case, run, out, seeds, drives, counts, margins, half_step, resume, cluster, profile, quiet)
    )


def sweep(
    case: CaseFolder | None = None,
    /,
    *,
    out: Path,
    design: str = "sobol:1024",
    seeds: Annotated[WholeNumber, Parameter(validator=Number(gte=1))] = 4,
    engine: Literal["surrogate", "sumo"] = "surrogate",
    seed: Annotated[WholeNumber, Parameter(validator=Number(gte=0, lte=2000))] = 0,
    parameters: Annotated[tuple[str, ...] | None, Parameter(consume_multiple=True, negative="")] = None,
    settings: Path | None = None,
    shard: str | None = None,
    merge: Annotated[bool, Parameter(negative="")] = False,
    cluster: str | None = None,
    resume: Annotated[bool, Parameter(negative="")] = False,
    profile: Profile = False,
    quiet: Quiet = False,
) -> int:
    """Run many parameter sets on several seeds each, and keep every run as a row of a table.

    The same command goes on with a sweep that was stopped. Leaves the table, and beside it a .json and a .html file.

    Parameters
    ----------
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
    """
    from jaxcalib.cli.sweep_command import SweepOptions, run_sweep

    options = SweepOptions(
        design=design, seeds=seeds, engine=engine, seed=seed, parameters=parameters, settings=settings, shard=shard,
        cluster=cluster, resume=resume,
    )  # fmt: skip
    return run_sweep(case, out, options, merge=merge, profile=profile, quiet=quiet)
